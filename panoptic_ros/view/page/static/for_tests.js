// What is shown, in numbers, for tests in a browser: window.panoptic.

import { rgbOfPart } from "#view/colors.js";
import { project } from "#view/lens.js";
import { place } from "#view/people.js";

export function exposeForTests({ page, tiles, stage, select, switchLayer, step, redraw }) {
  window.panoptic = {
    page, select, switchLayer, step, rgbOfPart,
    get ready() { return page.drawn > 0 && tiles.waiting === 0; },
    seek(t) { page.player.seek(t); page.player.playing = false; redraw(); },
    // CSS pixels in the window of points, and of a person's joints, in the 3D scene
    pixelsOf(points) {
      const box = stage.canvas.getBoundingClientRect();
      return points.map((at) => at && stage.pixelOf(at)).map((p) => p && [p[0] + box.x, p[1] + box.y]);
    },
    spacePixels(id) {
      const person = page.instant.people.find((each) => each.id === id);
      return this.pixelsOf(Array.from(person.states.keys(), (joint) => place(person, joint)));
    },
    // pixels of the camera's full image, and whether the tile has one
    tilePixels(name, id) {
      const { pair, canvas, camera } = tiles.tiles.get(name);
      const person = pair?.instant?.people.find((each) => each.id === id);
      return { t: pair?.instant?.t ?? null, preview: pair?.preview.t ?? null, box: canvas.getBoundingClientRect().toJSON(), index: pair?.instant?.index,
        frame: pair?.view?.message.frame_number,
        pixels: person ? Array.from(person.states.keys(), (joint) => place(person, joint)).map((at) => at && project(camera, ...at)) : [] };
    },
    stats() {
      return { t: page.player.t, drawn: page.drawn, ids: (page.instant?.people ?? []).map(({ id }) => id), images: page.pictures.size, problems: page.store.problems,
        tiles: [...tiles.tiles.values()].map(({ camera, pair }) => [camera.name, pair?.preview?.t ?? null]), newest: page.store.newest?.t ?? null };
    },
  };
}
