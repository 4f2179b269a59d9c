// Patches of the surface of people: where they lie, which way they face, and the part that they move with.

import { partColor, partCss } from "#view/colors.js";
import { patchesOf, seenBy } from "#view/patches.js";
import { Discs, Rods } from "#view/shapes.js";

const REACH = 0.1e9; // ns; older patches are not shown
const RADIUS = 0.014, NORMAL = 0.03, THIN = 0.0025; // m, of discs and normals

export const patches = {
  name: "patches", title: "Patches", on: false, hint: "patches of the surface with their normals, a colour per rigid part",
  keys: ["patches"],

  space(stage) {
    const group = stage.group(), discs = new Discs(group), rods = new Rods(group);
    return (scene) => {
      const message = scene.store.otherAt("patches", scene.t, REACH);
      discs.begin();
      rods.begin();
      for (const { at, normal, part } of patchesOf(message)) {
        const color = partColor(part);
        discs.add(at, normal, RADIUS, color);
        rods.add(at, at.map((x, k) => x + NORMAL * normal[k]), THIN, color);
      }
      discs.end();
      rods.end();
    };
  },

  tile(canvas, scene, { instant, view, preview }) {
    const t = instant?.t ?? view?.t ?? preview?.t;
    const message = t === undefined ? null : scene.store.otherAt("patches", t, REACH);
    const spots = new Map(); // by part
    for (const { at, part } of seenBy(message, canvas.camera.name)) {
      const spot = canvas.seen(at);
      if (spot) spots.set(part, [...(spots.get(part) ?? []), spot]);
    }
    for (const [part, seen] of spots) canvas.dots(seen, 0.85 * canvas.stroke, partCss(part));
  },
};
