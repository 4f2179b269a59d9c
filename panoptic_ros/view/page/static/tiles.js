// One picture per camera: its newest image with the people of the same stamp.

import { TileCanvas } from "#view/tile_canvas.js";
import { pickPerson } from "#view/people.js";
import { project } from "#view/lens.js";

const KEPT = 240; // decoded images
const MANY = 48; // cameras: beyond, only those in sight are decoded
const NEAR_PX = 12;

export class Tiles {
  // element: holds them. flat: settings of 2D contexts. changed: called when an image has been decoded. picked, looked: (what, camera).
  constructor(element, { flat, changed, picked, looked }) {
    this.element = element;
    this.flat = flat;
    this.changed = changed;
    this.picked = picked;
    this.looked = looked;
    this.tiles = new Map();
    this.decoded = []; // previews whose images are kept
    this.bones = [];
    this.waiting = 0; // images that are being decoded
    this.visible = new Set();
    this.watcher = new IntersectionObserver((entries) => {
      for (const { target, isIntersecting } of entries) this.visible[isIntersecting ? "add" : "delete"](target.dataset.camera);
      changed();
    });
    new ResizeObserver(() => { this.arrange(); changed(); }).observe(element);
  }

  begin(cameras, bones) {
    this.bones = bones;
    this.element.replaceChildren();
    this.watcher.disconnect();
    this.tiles.clear();
    for (const camera of cameras.values()) this.tiles.set(camera.name, this._make(camera));
    this.arrange();
  }

  // As many columns as make the tiles largest.
  arrange() {
    const tiles = [...this.tiles.values()];
    if (!tiles.length) return;
    const enlarged = tiles.find((tile) => tile.enlarged);
    const { clientWidth: w, clientHeight: h } = this.element;
    const ratio = tiles.reduce((sum, { camera }) => sum + camera.size[0] / camera.size[1], 0) / tiles.length;
    let best = [1, 0];
    for (let columns = 1; columns <= Math.min(tiles.length, 6); columns++) {
      const rows = Math.ceil(tiles.length / columns);
      const width = Math.min(w / columns, (h / rows - 36) * ratio);
      if (width > best[1]) best = [columns, width];
    }
    const least = Math.min(w / Math.min(tiles.length, 3), 150);
    const columns = enlarged ? 1 : best[1] >= least ? best[0] : Math.max(1, Math.floor(w / least));
    this.element.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
    const most = enlarged ? h - 40 : best[1] >= least ? h / Math.ceil(tiles.length / columns) - 36 : Infinity;
    for (const tile of tiles) {
      tile.element.hidden = Boolean(enlarged) && tile !== enlarged;
      const [width, height] = tile.camera.size;
      const shown = Math.max(60, Math.min(w / columns - 8, most * (width / height)));
      tile.canvas.style.width = `${shown}px`;
      tile.canvas.style.height = `${(shown * height) / width}px`;
      const dpr = Math.min(2, window.devicePixelRatio);
      tile.canvas.width = Math.round(shown * dpr);
      tile.canvas.height = Math.round(((shown * height) / width) * dpr);
      tile.drawn = "";
    }
  }

  // Draw what has changed. Returns the images that are shown, by camera.
  draw(scene, layers, version) {
    const pictures = new Map();
    for (const [name, tile] of this.tiles) {
      if (this.tiles.size > MANY && !this.visible.has(name)) continue;
      const wanted = scene.store.pairAt(name, scene.t);
      const ready = !wanted?.preview || this.decode(wanted.preview);
      // until an image is decoded, the newest one that is, with the people of its own stamp
      tile.pair = ready ? wanted : scene.store.pairAt(name, scene.t, (preview) => preview.bitmap) ?? tile.pair;
      if (tile.pair?.preview?.bitmap) pictures.set(name, tile.pair.preview.bitmap);
      if (this.visible.has(name) && !tile.element.hidden) this._draw(tile, scene, layers, version);
    }
    return pictures;
  }

  caption(name, parts, tone) {
    const tile = this.tiles.get(name);
    if (!tile) return;
    tile.facts.textContent = parts.join(" · ");
    tile.dot.className = `dot ${tone}`;
  }

  // Decode images that come next.
  prepare(pairs) {
    for (const pair of pairs) if (pair?.preview) this.decode(pair.preview);
  }

  _draw(tile, scene, layers, version) {
    const { canvas, camera, pair } = tile, stamp = pair ? `${pair.preview?.t} ${pair.view?.t} ${pair.instant?.t} ${version}` : `none ${version}`;
    if (tile.drawn === stamp) return;
    tile.drawn = stamp;
    const context = canvas.getContext("2d", this.flat);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = "#141a22";
    context.fillRect(0, 0, canvas.width, canvas.height);
    tile.empty.hidden = Boolean(pair?.preview);
    tile.empty.classList.toggle("corner", Boolean(pair));
    if (!pair) return;
    if (pair.preview?.bitmap) context.drawImage(pair.preview.bitmap, 0, 0, canvas.width, canvas.height);
    const drawing = new TileCanvas(context, camera, canvas.width, canvas.height);
    for (const layer of layers) if (layer.tile && layer.under) layer.tile(drawing, scene, pair);
    for (const layer of layers) if (layer.tile && !layer.under) layer.tile(drawing, scene, pair);
  }

  // Whether the image of a preview is decoded; if not, it is begun.
  decode(preview) {
    if (this.tiles.size > MANY && !this.visible.has(preview.camera)) return false;
    if (preview.bitmap) return true;
    if (!preview.asked) {
      preview.asked = true;
      this.waiting += 1;
      createImageBitmap(new Blob([preview.jpeg], { type: "image/jpeg" })).then((bitmap) => {
        preview.bitmap = bitmap;
        this.decoded.push(preview);
        while (this.decoded.length > KEPT * Math.max(1, this.tiles.size / 8)) this._forget(this.decoded.shift());
      }, () => {}).finally(() => { this.waiting -= 1; this.changed(); });
    }
    return false;
  }

  _forget(preview) {
    if ([...this.tiles.values()].some((tile) => tile.pair?.preview === preview)) return this.decoded.push(preview);
    preview.bitmap = null;
    preview.asked = false;
  }

  _make(camera) {
    const element = document.createElement("figure");
    element.className = "tile";
    element.dataset.camera = camera.name;
    element.innerHTML = '<figcaption><i class="dot"></i><b></b><span></span></figcaption><div class="empty">no image</div>';
    const canvas = document.createElement("canvas"), caption = element.querySelector("figcaption");
    element.append(canvas);
    element.querySelector("b").textContent = camera.name;
    const tile = { camera, element, canvas, pair: null, drawn: "", enlarged: false, facts: element.querySelector("span"),
      dot: element.querySelector(".dot"), empty: element.querySelector(".empty") };
    canvas.onclick = (event) => this.picked(this._pick(tile, event));
    canvas.title = "click a joint or a person; double click: enlarge; click the name: look from there";
    canvas.ondblclick = () => { tile.enlarged = !tile.enlarged; this.arrange(); this.changed(); };
    caption.onclick = () => this.looked(camera);
    this.element.append(element);
    this.watcher.observe(element);
    return tile;
  }

  _pick(tile, event) {
    const { canvas, camera, pair } = tile;
    const scale = camera.size[0] / canvas.clientWidth;
    const pixelOf = (point) => project(camera, ...point)?.map((x) => (x + 0.5) / scale);
    return pickPerson(pair?.instant?.people ?? [], this.bones, pixelOf, [event.offsetX, event.offsetY], NEAR_PX);
  }
}
