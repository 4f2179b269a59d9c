// Bodies as balls along their segments: tapered, and wider than deep where the shape says so.

// Balls of a body: {at: [x, y, z] m, axes: columns of a 3x3 matrix that turns the unit ball into it, radius}.
// shape: {scale: sum of the lengths of segments per stature, capsules: [{segment, from, to, radii, wide}]}, where
// an end is a point, in statures, or the name of the segment that begins there.
export function ballsOf(message, body, shape) {
  const names = message.segment_names, offsets = body.offsets;
  let lengths = 0;
  for (let s = 1; s < names.length; s++) lengths += Math.hypot(offsets[3 * s], offsets[3 * s + 1], offsets[3 * s + 2]);
  const tall = lengths / shape.scale, found = [];
  for (const { segment, from, to, radii, wide } of shape.capsules) {
    const s = names.indexOf(segment);
    if (s < 0) return [];
    const end = (place) => typeof place === "string" ? Array.from(offsets.subarray(3 * names.indexOf(place), 3 * names.indexOf(place) + 3)) : place.map((x) => tall * x);
    const turn = matrixOf(body.orientations, 4 * s), origin = body.positions.subarray(3 * s, 3 * s + 3);
    const a = end(from), b = end(to), least = tall * Math.min(...radii);
    const count = Math.max(2, Math.ceil(Math.hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]) / (0.5 * least)) + 1);
    for (let i = 0; i < count; i++) {
      const share = i / (count - 1), radius = tall * (radii[0] + share * (radii[1] - radii[0]));
      const local = a.map((x, k) => x + share * (b[k] - x)), size = [radius, radius * wide, radius];
      const at = [0, 1, 2].map((row) => origin[row] + turn[3 * row] * local[0] + turn[3 * row + 1] * local[1] + turn[3 * row + 2] * local[2]);
      found.push({ at, axes: turn.map((x, k) => x * size[k % 3]), radius });
    }
  }
  return found;
}

// Rows of the rotation matrix of a quaternion w x y z
function matrixOf(q, at) {
  const [w, x, y, z] = q.subarray(at, at + 4);
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ];
}
