// What the network scored: the sparse patches of its maps, over the image.

import { heat } from "#view/colors.js";

export const scoreMaps = {
  name: "scores", title: "Score maps", on: false, hint: "where the network saw joints; of the selected one if a joint is selected",
  keys: [], under: true,

  tile(canvas, scene, { view }) {
    if (!view?.message.has_maps) return;
    const maps = view.message.maps, wanted = scene.selected?.joint;
    const [a, b, c, d, e, f] = maps.grid_from_image, det = a * e - b * d;
    const { context } = canvas;
    context.save();
    context.globalCompositeOperation = "lighter";
    let start = 0;
    for (let i = 0; i < maps.joints.length; i++) {
      const [columns, rows] = [maps.sizes[2 * i], maps.sizes[2 * i + 1]];
      if (wanted === undefined || wanted === null || maps.joints[i] === wanted) {
        const patch = paint(maps.data.subarray(start, start + columns * rows), columns, rows);
        // cells to pixels, to the tile; the corner of a cell lies half a cell before its centre
        const x = maps.corners[2 * i] - 0.5 - c, y = maps.corners[2 * i + 1] - 0.5 - f;
        const u = (e * x - b * y) / det + 0.5, v = (a * y - d * x) / det + 0.5;
        context.setTransform((e / det) * canvas.scaleX, (-d / det) * canvas.scaleY, (-b / det) * canvas.scaleX,
          (a / det) * canvas.scaleY, u * canvas.scaleX, v * canvas.scaleY);
        context.drawImage(patch, 0, 0);
      }
      start += columns * rows;
    }
    context.restore();
  },
};

function paint(data, columns, rows) {
  const patch = new OffscreenCanvas(columns, rows), context = patch.getContext("2d");
  const image = context.createImageData(columns, rows);
  for (let i = 0; i < data.length; i++) {
    const [r, g, b] = heat(data[i] / 255);
    image.data.set([r, g, b, Math.min(255, 1.4 * data[i])], 4 * i);
  }
  context.putImageData(image, 0, 0);
  return patch;
}
