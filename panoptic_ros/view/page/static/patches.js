// What a message of patches holds, patch by patch: {at: [x, y, z] m, normal: unit, part}.

const LEAST_SEEN = 0.5; // how likely a camera sees a patch that is drawn into its picture

export function patchesOf(message) {
  const found = [];
  for (let i = 0; i < (message?.parts.length ?? 0); i++) found.push(patch(message, i));
  return found;
}

// Those that a camera sees, by what the message says of it.
export function seenBy(message, camera) {
  const column = message?.cameras.indexOf(camera) ?? -1, found = [];
  if (column < 0) return found;
  const columns = message.cameras.length;
  for (let i = 0; i < message.parts.length; i++) {
    if (message.visible[i * columns + column] >= LEAST_SEEN) found.push(patch(message, i));
  }
  return found;
}

function patch(message, i) {
  const three = (values) => Array.from(values.subarray(3 * i, 3 * i + 3));
  return { at: three(message.positions), normal: three(message.normals), part: message.parts[i] };
}
