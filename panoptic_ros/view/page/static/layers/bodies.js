// Bodies of designated people, as thick as people are.

import { colorOf, cssOf } from "#view/colors.js";
import { ballsOf } from "#view/bodies.js";
import { Balls } from "#view/shapes.js";

const REACH = 0.1e9; // ns; an older body is not shown

export const bodies = {
  name: "bodies", title: "Bodies", on: true, hint: "bodies of designated people, by their segments", keys: ["bodies"],
  under: true,

  space(stage) {
    const balls = new Balls(stage.group());
    return (scene) => {
      const message = scene.store.otherAt("bodies", scene.t, REACH);
      balls.begin();
      for (const body of message?.bodies ?? []) {
        const color = colorOf(body.id);
        for (const { at, axes } of ballsOf(message, body, scene.facts.shape)) balls.addTurned(at, axes, color);
      }
      balls.end();
    };
  },

  tile(canvas, scene, { instant, view, preview }) {
    const t = instant?.t ?? view?.t ?? preview?.t;
    const message = t === undefined ? null : scene.store.otherAt("bodies", t, REACH);
    for (const body of message?.bodies ?? []) {
      const color = cssOf(body.id, 0.22);
      for (const { at, radius } of ballsOf(message, body, scene.facts.shape)) {
        const spot = canvas.seen(at), top = canvas.seen([at[0], at[1], at[2] + radius]);
        const side = canvas.seen([at[0] + radius, at[1], at[2]]), other = canvas.seen([at[0], at[1] + radius, at[2]]);
        if (!spot || !top || !side || !other) continue;
        const size = Math.max(...[top, side, other].map((p) => Math.hypot(p[0] - spot[0], p[1] - spot[1])));
        canvas.dot(spot, size, color);
      }
    }
  },
};
