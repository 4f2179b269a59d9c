// ROS messages from their CDR bytes, by definitions that the server tells: {type: [[field, type, count], ...]}.

const SIZES = { bool: 1, byte: 1, char: 1, int8: 1, uint8: 1, int16: 2, uint16: 2, int32: 4, uint32: 4,
  int64: 8, uint64: 8, float32: 4, float64: 8 };
const ARRAYS = { bool: Uint8Array, byte: Uint8Array, char: Uint8Array, int8: Int8Array, uint8: Uint8Array,
  int16: Int16Array, uint16: Uint16Array, int32: Int32Array, uint32: Uint32Array, int64: BigInt64Array,
  uint64: BigUint64Array, float32: Float32Array, float64: Float64Array };
const READ = { bool: "getUint8", byte: "getUint8", char: "getUint8", int8: "getInt8", uint8: "getUint8",
  int16: "getInt16", uint16: "getUint16", int32: "getInt32", uint32: "getUint32", int64: "getBigInt64",
  uint64: "getBigUint64", float32: "getFloat32", float64: "getFloat64" };
const TEXT = new TextDecoder();

export class Decoder {
  constructor(schemas) {
    this.schemas = schemas;
  }

  // A message; `bytes` is a Uint8Array. Numbers of 64 bits become Numbers, which are exact up to 2^53.
  decode(bytes, type) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const cursor = { view, at: 4, little: view.getUint8(1) !== 0 };
    return this._struct(cursor, type);
  }

  _struct(cursor, type) {
    const fields = this.schemas[type];
    if (!fields) throw new Error(`no definition of ${type}`);
    const message = {};
    for (const [name, inner, count] of fields) message[name] = this._field(cursor, inner, count);
    return message;
  }

  _field(cursor, type, count) {
    if (count === 0) return this._one(cursor, type);
    const length = count < 0 ? this._number(cursor, "uint32") : count;
    if (type in SIZES) return this._array(cursor, type, length);
    const items = new Array(length);
    for (let i = 0; i < length; i++) items[i] = this._one(cursor, type);
    return items;
  }

  _one(cursor, type) {
    if (type in SIZES) return this._number(cursor, type);
    if (type !== "string") return this._struct(cursor, type);
    const length = this._number(cursor, "uint32");
    const start = cursor.view.byteOffset + cursor.at;
    cursor.at += length;
    return TEXT.decode(new Uint8Array(cursor.view.buffer, start, Math.max(0, length - 1)));
  }

  _number(cursor, type) {
    align(cursor, SIZES[type]);
    const value = cursor.view[READ[type]](cursor.at, cursor.little);
    cursor.at += SIZES[type];
    return typeof value === "bigint" ? Number(value) : type === "bool" ? value !== 0 : value;
  }

  _array(cursor, type, length) {
    if (length > 0) align(cursor, SIZES[type]);
    const start = cursor.view.byteOffset + cursor.at;
    const size = length * SIZES[type];
    if (cursor.at + size > cursor.view.byteLength) throw new Error("a message is shorter than it says");
    cursor.at += size;
    const Kind = ARRAYS[type];
    const inPlace = start % SIZES[type] === 0 && cursor.little;
    const copy = () => ordered(cursor.view.buffer.slice(start, start + size), SIZES[type], cursor.little);
    const values = inPlace ? new Kind(cursor.view.buffer, start, length) : new Kind(copy());
    return values instanceof BigUint64Array || values instanceof BigInt64Array ? Array.from(values, Number) : values;
  }
}

// A buffer of values in this machine's order, little endian as all that browsers run on.
function ordered(buffer, size, little) {
  if (little || size === 1) return buffer;
  const bytes = new Uint8Array(buffer);
  for (let at = 0; at < bytes.length; at += size) bytes.subarray(at, at + size).reverse();
  return buffer;
}

function align(cursor, size) {
  cursor.at += (size - ((cursor.at - 4) % size)) % size;
}
