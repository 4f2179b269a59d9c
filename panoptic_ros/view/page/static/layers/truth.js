// Who was really there, where that is known.

import { Color } from "#view/vendor/three.js";
import { Rods } from "#view/shapes.js";
import { place } from "#view/people.js";

const WHITE = new Color(0.93, 0.95, 1), RADIUS = 0.007; // m
const NEAR = 8e6; // ns, by which stamps of one instant differ
const LINES = "rgba(125,240,255,.95)";

export const truth = {
  name: "truth", title: "Truth", on: true, hint: "white: where joints really were", keys: ["truth"],

  space(stage) {
    const rods = new Rods(stage.group());
    return (scene) => {
      rods.begin();
      for (const person of scene.store.otherAt("truth", scene.t)?.skeletons ?? []) {
        for (const [parent, child] of scene.facts.skeleton.bones) {
          const a = place(person, parent), b = place(person, child);
          if (a && b) rods.add(a, b, RADIUS, WHITE);
        }
      }
      rods.end();
    };
  },

  tile(canvas, scene, { preview, view }) {
    const t = preview?.t ?? view?.t;
    for (const person of (t !== undefined && scene.store.otherAt("truth", t + NEAR))?.skeletons ?? []) {
      for (const [parent, child] of scene.facts.skeleton.bones) {
        const a = place(person, parent), b = place(person, child);
        if (a && b) canvas.segment(a, b, LINES, 0.5 * canvas.stroke);
      }
    }
  },
};
