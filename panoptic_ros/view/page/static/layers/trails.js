// Where people came from: the middle of each body over the last seconds, fading.

import { colorOf } from "#view/colors.js";
import { Rods } from "#view/shapes.js";
import { place } from "#view/people.js";

const SECONDS = 3, PIECES = 60, RADIUS = 0.006;
const FADED = 0.16;
const FAR = 0.5; // m between two pieces: somebody who came back, not a step

export const trails = {
  name: "trails", title: "Trails", on: true, hint: "the middle of each body over the last three seconds", keys: [],

  space(stage) {
    const rods = new Rods(stage.group());
    return (scene) => {
      rods.begin();
      const past = scene.store.between(scene.t - SECONDS * 1e9, scene.t);
      const step = Math.max(1, Math.floor(past.length / PIECES));
      const before = new Map();
      for (let i = past.length - 1; i >= 0; i -= step) {
        const left = 1 - (scene.t - past[i].t) / (SECONDS * 1e9);
        for (const person of past[i].people) {
          const here = place(person, scene.facts.skeleton.root), last = before.get(person.id);
          if (here && last && Math.hypot(here[0] - last[0], here[1] - last[1], here[2] - last[2]) < FAR) {
            rods.add(last, here, RADIUS, colorOf(person.id, FADED + (1 - FADED) * left));
          }
          if (here) before.set(person.id, here);
        }
      }
      rods.end();
    };
  },
};
