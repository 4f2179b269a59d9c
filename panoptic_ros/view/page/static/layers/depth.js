// How far each view sees: depth that came with its 2D people.

import { heat } from "#view/colors.js";

const FARTHEST = 8000; // mm

export const depth = {
  name: "depth", title: "Depth", on: false, hint: "how far each view sees, near is bright, up to 8 m", keys: [],
  under: true,

  tile(canvas, scene, { view }) {
    if (!view?.message.limit_rows) return;
    const { limit_rows: rows, limit_columns: columns, limits } = view.message;
    const map = new OffscreenCanvas(columns, rows), context = map.getContext("2d");
    const image = context.createImageData(columns, rows);
    for (let i = 0; i < limits.length; i++) {
      if (limits[i]) image.data.set([...heat(1 - limits[i] / FARTHEST), 170], 4 * i);
    }
    context.putImageData(image, 0, 0);
    canvas.context.drawImage(map, 0, 0, canvas.width, canvas.height);
  },
};
