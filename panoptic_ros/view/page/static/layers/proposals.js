// Where score maps of several views agree: nodes of voting, brighter the more they scored.

import { Color } from "#view/vendor/three.js";
import { Balls } from "#view/shapes.js";

const RADIUS = 0.02; // m

export const proposals = {
  name: "proposals", title: "Proposals", on: false, hint: "where the views' scores meet, before people are assembled",
  keys: ["proposals"],

  space(stage) {
    const balls = new Balls(stage.group());
    return (scene) => {
      const message = scene.store.otherAt("proposals", scene.t);
      balls.begin();
      for (let i = 0; i < (message?.node_joints.length ?? 0); i++) {
        const score = Math.min(1, message.node_scores[i]), wanted = scene.selected?.joint;
        if (Number.isInteger(wanted) && message.node_joints[i] !== wanted) continue;
        balls.add(message.nodes.subarray(3 * i, 3 * i + 3), RADIUS, new Color(0.2 + 0.8 * score, 0.9, 0.3 + 0.5 * score));
      }
      balls.end();
    };
  },
};
