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
