// People in 3D, and projected into every camera: a colour per id, thin and dim where not measured.

import { Color } from "#view/vendor/three.js";
import { colorOf, cssOf } from "#view/colors.js";
import { Rods, Balls } from "#view/shapes.js";
import { MEASURED, place } from "#view/people.js";

const BONE = 0.016, JOINT = 0.024; // m
const WHITE = new Color(1, 1, 1);
const DIM = 0.35; // of what is predicted or filled

export const skeletons = {
  name: "skeletons", title: "Skeletons", on: true, hint: "people in 3D and projected through each lens",
  keys: [],

  space(stage) {
    const rods = new Rods(stage.group()), balls = new Balls(stage.group());
    return (scene) => {
      rods.begin();
      balls.begin();
      for (const person of scene.instant?.people ?? []) drawPerson(person, scene, rods, balls);
      rods.end();
      balls.end();
    };
  },

  tile(canvas, scene, pair) {
    for (const person of pair.instant?.people ?? []) {
      const color = cssOf(person.id);
      for (const [parent, child] of scene.facts.skeleton.bones) {
        const a = place(person, parent), b = place(person, child);
        const solid = person.states[parent] === MEASURED && person.states[child] === MEASURED;
        if (a && b) canvas.segment(a, b, color, canvas.stroke * (solid ? 1 : 0.55));
      }
      for (let joint = 0; joint < person.states.length; joint++) {
        const spot = canvas.seen(place(person, joint));
        const chosen = scene.selected?.id === person.id && scene.selected.joint === joint;
        if (spot) canvas.dot(spot, canvas.stroke * (chosen ? 2.2 : 1.05), chosen ? "#fff" : color, person.states[joint] !== MEASURED);
      }
      const head = canvas.seen(place(person, scene.facts.skeleton.head));
      if (head && head[0] > 0 && head[1] > 0 && head[0] < canvas.width && head[1] < canvas.height) {
        canvas.label(String(person.id), [head[0], Math.max(14, head[1] - 7 * canvas.stroke)], color);
      }
    }
  },
};

function drawPerson(person, scene, rods, balls) {
  const bright = colorOf(person.id), dim = colorOf(person.id, DIM);
  for (const [parent, child] of scene.facts.skeleton.bones) {
    const a = place(person, parent), b = place(person, child);
    if (!a || !b) continue;
    const solid = person.states[parent] === MEASURED && person.states[child] === MEASURED;
    rods.add(a, b, solid ? BONE : 0.55 * BONE, solid ? bright : dim);
  }
  for (let joint = 0; joint < person.states.length; joint++) {
    const at = place(person, joint);
    if (!at) continue;
    const chosen = scene.selected?.id === person.id && scene.selected.joint === joint;
    const small = person.states[joint] !== MEASURED;
    balls.add(at, chosen ? 2 * JOINT : small ? 0.7 * JOINT : JOINT, chosen ? WHITE : small ? dim : bright);
  }
}
