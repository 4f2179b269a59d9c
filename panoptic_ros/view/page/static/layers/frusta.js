// Cameras where they stand, with what they see, undistorted.

import { BufferAttribute, BufferGeometry, CanvasTexture, DoubleSide, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial, SRGBColorSpace } from "#view/vendor/three.js";
import { unproject } from "#view/lens.js";

const CELLS = 8; // of the picture along each side, as lenses bend it

export const frusta = {
  name: "frusta", title: "Cameras", on: true, hint: "where cameras stand, with their images", keys: [],

  space(stage) {
    const group = stage.group();
    let shown = null, cameras = new Map();
    return (scene) => {
      if (shown !== scene.facts) {
        shown = scene.facts;
        group.clear();
        cameras = new Map([...scene.cameras].map(([name, camera]) => [name, makeFrustum(group, camera, stage.frustumDepth(scene.cameras))]));
      }
      for (const [name, frustum] of cameras) show(frustum, scene.pictures.get(name));
    };
  },
};

function makeFrustum(group, camera, depth) {
  const [width, height] = camera.size, points = [], uvs = [], faces = [];
  for (let row = 0; row <= CELLS; row++) {
    for (let column = 0; column <= CELLS; column++) {
      points.push(...unproject(camera, (column / CELLS) * width - 0.5, (row / CELLS) * height - 0.5, depth));
      uvs.push(column / CELLS, row / CELLS);
    }
  }
  const at = (row, column) => row * (CELLS + 1) + column;
  for (let row = 0; row < CELLS; row++) {
    for (let column = 0; column < CELLS; column++) {
      faces.push(at(row, column), at(row + 1, column), at(row, column + 1), at(row, column + 1), at(row + 1, column), at(row + 1, column + 1));
    }
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
  geometry.setAttribute("uv", new BufferAttribute(new Float32Array(uvs), 2));
  geometry.setIndex(faces);
  const picture = new Mesh(geometry, new MeshBasicMaterial({ side: DoubleSide, transparent: true, opacity: 0.9 }));
  picture.visible = false;
  group.add(picture);
  group.add(makeEdges(camera, points, at));
  return { picture, bitmap: null };
}

function makeEdges(camera, points, at) {
  const corner = (row, column) => points.slice(3 * at(row, column), 3 * at(row, column) + 3);
  const ends = [];
  for (const [row, column] of [[0, 0], [0, CELLS], [CELLS, 0], [CELLS, CELLS]]) ends.push(...camera.centre, ...corner(row, column));
  for (let i = 0; i < CELLS; i++) {
    ends.push(...corner(0, i), ...corner(0, i + 1), ...corner(CELLS, i), ...corner(CELLS, i + 1));
    ends.push(...corner(i, 0), ...corner(i + 1, 0), ...corner(i, CELLS), ...corner(i + 1, CELLS));
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(ends), 3));
  return new LineSegments(geometry, new LineBasicMaterial({ color: 0x7f93ad }));
}

function show(frustum, bitmap) {
  if (!bitmap || frustum.bitmap === bitmap) return;
  const { material } = frustum.picture;
  const same = material.map && material.map.image.width === bitmap.width && material.map.image.height === bitmap.height;
  if (!same) {
    material.map?.dispose();
    material.map = new CanvasTexture(bitmap);
    material.map.colorSpace = SRGBColorSpace;
    material.map.flipY = false;
    material.needsUpdate = true;
  }
  material.map.image = bitmap;
  material.map.needsUpdate = true;
  frustum.bitmap = bitmap;
  frustum.picture.visible = true;
}
