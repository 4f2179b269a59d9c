// Where each joint may be: ellipsoids of two standard deviations.

import { MeshLambertMaterial } from "#view/vendor/three.js";
import { colorOf } from "#view/colors.js";
import { Balls } from "#view/shapes.js";
import { cholesky, place } from "#view/people.js";

const SIGMAS = 2;
const LARGEST = 1; // m; what is less certain says nothing

export const covariance = {
  name: "covariance", title: "Covariance", on: true, hint: "ellipsoids of two standard deviations", keys: [],

  space(stage) {
    const glass = new MeshLambertMaterial({ transparent: true, opacity: 0.22, depthWrite: false });
    const balls = new Balls(stage.group(), glass);
    return (scene) => {
      balls.begin();
      for (const person of scene.instant?.people ?? []) {
        const color = colorOf(person.id);
        for (let joint = 0; joint < person.states.length; joint++) {
          const at = place(person, joint), c = person.covariances;
          if (!at || !(c[9 * joint] + c[9 * joint + 4] + c[9 * joint + 8] < LARGEST)) continue;
          balls.addEllipsoid(at, cholesky(c, 9 * joint), SIGMAS, color);
        }
      }
      balls.end();
    };
  },
};
