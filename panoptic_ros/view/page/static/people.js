// Skeletons in numbers: joints, spreads, and how well views agree with them.

import { project } from "#view/lens.js";

export const MISSING = 0, MEASURED = 1, PREDICTED = 2, FILLED = 3;
export const STATES = ["missing", "measured", "predicted", "filled"];

export function isThere(person, joint) {
  return person.states[joint] !== MISSING && Number.isFinite(person.positions[3 * joint]);
}

// [x, y, z] m of a joint, null if it is missing
export function place(person, joint) {
  return isThere(person, joint) ? Array.from(person.positions.subarray(3 * joint, 3 * joint + 3)) : null;
}

// Standard deviations along x, y, z in mm
export function spread(person, joint) {
  const c = person.covariances;
  return [0, 4, 8].map((i) => 1000 * Math.sqrt(Math.max(0, c[9 * joint + i])));
}

// The columns of L with L L^T = covariance: they turn the unit ball into the ball of one standard deviation.
export function cholesky(c, at = 0) {
  const l00 = Math.sqrt(Math.max(c[at], 1e-12));
  const l10 = c[at + 3] / l00, l20 = c[at + 6] / l00;
  const l11 = Math.sqrt(Math.max(c[at + 4] - l10 * l10, 1e-12));
  const l21 = (c[at + 7] - l20 * l10) / l11;
  const l22 = Math.sqrt(Math.max(c[at + 8] - l20 * l20 - l21 * l21, 1e-12));
  return [l00, l10, l20, l11, l21, l22];
}

// Standard deviations along the principal axes, mm, largest first (Jacobi's method)
export function principalSpread(person, joint) {
  const c = Array.from(person.covariances.subarray(9 * joint, 9 * joint + 9));
  const a = [[c[0], c[1], c[2]], [c[3], c[4], c[5]], [c[6], c[7], c[8]]];
  for (let sweep = 0; sweep < 12; sweep++) {
    for (const [p, q] of [[0, 1], [0, 2], [1, 2]]) {
      if (Math.abs(a[p][q]) < 1e-18) continue;
      const theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
      const t = Math.sign(theta || 1) / (Math.abs(theta) + Math.sqrt(theta * theta + 1));
      const cos = 1 / Math.sqrt(t * t + 1), sin = t * cos;
      for (let k = 0; k < 3; k++) [a[k][p], a[k][q]] = [cos * a[k][p] - sin * a[k][q], sin * a[k][p] + cos * a[k][q]];
      for (let k = 0; k < 3; k++) [a[p][k], a[q][k]] = [cos * a[p][k] - sin * a[q][k], sin * a[p][k] + cos * a[q][k]];
    }
  }
  return [0, 1, 2].map((i) => 1000 * Math.sqrt(Math.max(0, a[i][i]))).sort((x, y) => y - x);
}

// How each view of an instant sees a joint: [{camera, state, score, residual: [dx, dy] px or null}].
// residual: what the view saw less where the joint projects to.
export function evidence(store, cameras, instant, person, joint) {
  const found = place(person, joint);
  return instant.cameras.map((name, i) => {
    const camera = cameras.get(name), view = store.viewOf(name, instant);
    const index = person.view_persons.length ? person.view_persons[i] : -1;
    const row = { camera: name, score: 0, residual: null, state: "not seen" };
    if (index < 0) return row;
    if (!view) return { ...row, state: "matched" };
    const at = index * view.message.joint_count + joint;
    row.score = view.message.scores[at] ?? 0;
    const pixel = found && camera && project(camera, ...found);
    if (row.score > 0 && pixel) {
      row.residual = [view.message.points[2 * at] - pixel[0], view.message.points[2 * at + 1] - pixel[1]];
      row.state = "seen";
    } else row.state = "joint not seen";
    return row;
  });
}

// The same of all joints of a person: [{camera, state, joints that it saw, rms of their residuals px or null}].
export function personEvidence(store, cameras, instant, person) {
  const rows = new Map();
  for (let joint = 0; joint < person.states.length; joint++) {
    for (const { camera, state, residual } of evidence(store, cameras, instant, person, joint)) {
      const row = rows.get(camera) ?? { camera, state: state === "joint not seen" ? "seen" : state, joints: 0, squares: 0 };
      rows.set(camera, row);
      row.joints += residual ? 1 : 0;
      row.squares += residual ? residual[0] ** 2 + residual[1] ** 2 : 0;
    }
  }
  return [...rows.values()].map(({ squares, ...row }) => ({ ...row, rms: row.joints ? Math.sqrt(squares / row.joints) : null }));
}

// What a click on a picture means: the nearest joint within `near`, else the person one of whose bones lies
// there: {id, joint: a number or null}; null if nobody does. pixelOf: of a point of the world, null if not seen.
export function pickPerson(people, bones, pixelOf, spot, near) {
  let joints = { least: near, found: null }, limbs = { least: near, found: null };
  for (const person of people) {
    const pixels = Array.from(person.states.keys(), (joint) => place(person, joint)).map((at) => at && pixelOf(at));
    pixels.forEach((pixel, joint) => { joints = closer(joints, pixel, pixel, spot, { id: person.id, joint }); });
    for (const [a, b] of bones) limbs = closer(limbs, pixels[a], pixels[b], spot, { id: person.id, joint: null });
  }
  return joints.found ?? limbs.found;
}

// Whichever is nearer to a spot: what was best, or something between two pixels.
function closer(best, a, b, spot, found) {
  if (!a || !b) return best;
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]], square = dx * dx + dy * dy;
  const share = square ? Math.min(1, Math.max(0, ((spot[0] - a[0]) * dx + (spot[1] - a[1]) * dy) / square)) : 0;
  const away = Math.hypot(a[0] + share * dx - spot[0], a[1] + share * dy - spot[1]);
  return away < best.least ? { least: away, found } : best;
}
