// What can be drawn: one module and one row each. A layer has
//   name, title: for the switch; on: whether it is shown at first; hint: what it shows
//   keys: topics that it needs beside skeletons, 2D people and previews
//   space(stage): makes its part of the 3D scene, gives a function (scene) that updates it
//   tile(canvas, scene, pair): draws into a camera's picture; `under`: below the people
// `scene` is {facts, cameras, store, t, instant, selected}; `pair` is {preview, view, instant} of one stamp.

import { skeletons } from "#view/layers/skeletons.js";
import { covariance } from "#view/layers/covariance.js";
import { trails } from "#view/layers/trails.js";
import { frusta } from "#view/layers/frusta.js";
import { detected } from "#view/layers/detected.js";
import { scoreMaps } from "#view/layers/score_maps.js";
import { depth } from "#view/layers/depth.js";
import { proposals } from "#view/layers/proposals.js";
import { bodies } from "#view/layers/bodies.js";
import { patches } from "#view/layers/patches.js";
import { truth } from "#view/layers/truth.js";

export const LAYERS = [skeletons, covariance, trails, frusta, detected, scoreMaps, depth, proposals, bodies, patches, truth];
