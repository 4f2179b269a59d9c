// Drawing into a camera's picture, in the pixels of its full image.

import { project } from "#view/lens.js";

const PIECES = 8; // of a bone, as lenses bend lines

export class TileCanvas {
  constructor(context, camera, width, height) {
    this.context = context;
    this.camera = camera;
    this.scaleX = width / camera.size[0];
    this.scaleY = height / camera.size[1];
    this.width = width;
    this.height = height;
    this.stroke = Math.max(1.5, Math.min(width, height) / 120);
  }

  // Where a pixel of the full image is drawn; the centre of the first one is 0, 0.
  at(u, v) {
    return [(u + 0.5) * this.scaleX, (v + 0.5) * this.scaleY];
  }

  // Where a point of the world is drawn, null if it is not seen.
  seen(point) {
    const pixel = point && project(this.camera, ...point);
    return pixel && this.at(...pixel);
  }

  // A line between two points of the world, bent as the lens bends it.
  segment(a, b, color, width) {
    const path = new Path2D();
    let drawing = false;
    for (let i = 0; i <= PIECES; i++) {
      const s = i / PIECES;
      const spot = this.seen([a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]), a[2] + s * (b[2] - a[2])]);
      if (!spot || Math.abs(spot[0]) > 1e5 || Math.abs(spot[1]) > 1e5) drawing = false;
      else if (drawing) path.lineTo(...spot);
      else { path.moveTo(...spot); drawing = true; }
    }
    this._stroke(path, "rgba(8,10,14,.75)", width + 1.6);
    this._stroke(path, color, width);
  }

  // A line between two pixels of the full image.
  line(a, b, color, width) {
    const path = new Path2D();
    path.moveTo(...this.at(...a));
    path.lineTo(...this.at(...b));
    this._stroke(path, color, width);
  }

  dot(spot, radius, color, hollow = false) {
    const path = new Path2D();
    path.arc(spot[0], spot[1], radius, 0, 2 * Math.PI);
    if (hollow) return this._stroke(path, color, Math.max(1, radius * 0.5));
    this.context.fillStyle = color;
    this.context.fill(path);
  }

  // Many of one colour, in one go.
  dots(spots, radius, color) {
    const path = new Path2D();
    for (const [x, y] of spots) {
      path.moveTo(x + radius, y);
      path.arc(x, y, radius, 0, 2 * Math.PI);
    }
    this.context.fillStyle = color;
    this.context.fill(path);
  }

  label(text, spot, color) {
    const size = Math.max(10, 4.5 * this.stroke);
    this.context.font = `600 ${size}px system-ui, sans-serif`;
    this.context.textAlign = "center";
    this.context.lineWidth = 3;
    this.context.strokeStyle = "rgba(8,10,14,.85)";
    this.context.strokeText(text, ...spot);
    this.context.fillStyle = color;
    this.context.fillText(text, ...spot);
  }

  _stroke(path, color, width) {
    this.context.lineCap = this.context.lineJoin = "round";
    this.context.strokeStyle = color;
    this.context.lineWidth = width;
    this.context.stroke(path);
  }
}
