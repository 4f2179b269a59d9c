// From the world to pixels through the whole lens, as geometry/pinhole.py, brown.py and fisheye.py do it.

const MIN_DEPTH = 1e-3; // m
const TINY = 1e-12;

// A camera as the server describes it, with numbers at hand.
export function makeCamera(facts) {
  const limit = facts.radius_limit === null ? Infinity : facts.radius_limit;
  return { ...facts, R: facts.rotation, t: facts.translation, K: facts.matrix, d: facts.distortion, limit2: limit * limit };
}

// [x, y, z] in the camera's frame, m.
export function toCamera(camera, x, y, z) {
  const { R, t } = camera;
  return [R[0] * x + R[1] * y + R[2] * z + t[0], R[3] * x + R[4] * y + R[5] * z + t[1], R[6] * x + R[7] * y + R[8] * z + t[2]];
}

// Pixel [u, v] of a point of the world, m; null where the camera cannot see it. Borders are not tested.
export function project(camera, x, y, z) {
  const [a, b, depth] = toCamera(camera, x, y, z);
  if (!(depth > MIN_DEPTH)) return null;
  const u = a / depth, v = b / depth;
  if (!(u * u + v * v < camera.limit2)) return null;
  const [p, q] = camera.lens === "fisheye" ? fisheye(camera.d, u, v) : brown(camera.d, u, v);
  const K = camera.K;
  return [K[0] * p + K[1] * q + K[2], K[3] * p + K[4] * q + K[5]];
}

// Terms that a lens lacks are 0; the last two tilt the sensor.
function brown([k1, k2, p1, p2, k3, k4 = 0, k5 = 0, k6 = 0, s1 = 0, s2 = 0, s3 = 0, s4 = 0, tauX = 0, tauY = 0], x, y) {
  const r2 = x * x + y * y;
  const radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)));
  const p = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2);
  const q = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + r2 * s4);
  return tauX || tauY ? tilted(tauX, tauY, p, q) : [p, q];
}

function tilted(tauX, tauY, p, q) {
  const cx = Math.cos(tauX), sx = Math.sin(tauX), cy = Math.cos(tauY), sy = Math.sin(tauY);
  const a = cy * p + sy * sx * q - sy * cx, b = cx * q + sx, c = sy * p - cy * sx * q + cy * cx;
  return [cy * cx * (a / c) + sy * cx, cy * cx * (b / c) - sx];
}

function fisheye([k1, k2, k3, k4], x, y) {
  const radius = Math.max(Math.hypot(x, y), TINY);
  const theta = Math.atan(radius), s = theta * theta;
  const scale = (theta * (1 + s * (k1 + s * (k2 + s * (k3 + s * k4))))) / radius;
  return [x * scale, y * scale];
}

// The ray [x, y, z] in the world of a pixel, of length 1 along the axis: the lens undone by Newton's method.
export function unproject(camera, u, v, depth = 1) {
  const K = camera.K;
  const y0 = (v - K[5]) / K[4], x0 = (u - K[2] - K[1] * y0) / K[0];
  let x = x0, y = y0;
  const lens = camera.lens === "fisheye" ? fisheye : brown;
  for (let i = 0; i < 20; i++) {
    const [p, q] = lens(camera.d, x, y), h = 1e-6;
    const [px, qx] = lens(camera.d, x + h, y), [py, qy] = lens(camera.d, x, y + h);
    const a = (px - p) / h, b = (py - p) / h, c = (qx - q) / h, d = (qy - q) / h;
    const det = a * d - b * c;
    if (Math.abs(det) < 1e-9) break;
    const ex = x0 - p, ey = y0 - q;
    x += (d * ex - b * ey) / det;
    y += (a * ey - c * ex) / det;
    if (Math.abs(ex) + Math.abs(ey) < 1e-10) break;
  }
  const { R, t } = camera;
  const a = x * depth - t[0], b = y * depth - t[1], c = depth - t[2];
  return [R[0] * a + R[3] * b + R[6] * c, R[1] * a + R[4] * b + R[7] * c, R[2] * a + R[5] * b + R[8] * c];
}
