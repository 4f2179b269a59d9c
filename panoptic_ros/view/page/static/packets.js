// Packets as `packets.py` makes them: {kind, number, messages: [{topic, bytes}]}.

const MAGIC = 0x314e4150;
export const LIVE = 0;
export const BLOCK = 1;

export function unpack(buffer) {
  const view = new DataView(buffer);
  if (view.byteLength < 16 || view.getUint32(0, true) !== MAGIC) throw new Error("no packet");
  const packet = { kind: view.getUint32(4, true), number: view.getUint32(8, true), messages: [] };
  const count = view.getUint32(12, true);
  let at = 16;
  for (let i = 0; i < count; i++) {
    const topic = view.getUint32(at, true), length = view.getUint32(at + 4, true);
    packet.messages.push({ topic, bytes: new Uint8Array(buffer, at + 12, length) });
    at += 12 + length;
    at += (8 - (at % 8)) % 8;
  }
  return packet;
}
