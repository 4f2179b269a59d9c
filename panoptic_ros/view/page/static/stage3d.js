// The 3D scene: floor, light, the eye and its controls, labels, and who lies under the pointer.

import { Color, DirectionalLight, GridHelper, Group, HemisphereLight, OrbitControls, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "#view/vendor/three.js";
import { cssOf } from "#view/colors.js";
import { isThere, pickPerson, place } from "#view/people.js";

const BACKGROUND = 0x0e1218;
const NEAR_PX = 16; // from a click to a joint or a bone
const BY_PROCESSOR = /swiftshader|llvmpipe|softpipe|software|basic render/i; // names of what draws without a graphics card
const MANY = 40; // cameras: the names of more would cover each other

export class Stage3D {
  // canvas, labels: elements that lie over each other. changed: called when something is to be drawn anew.
  constructor(canvas, labels, changed) {
    this.canvas = canvas;
    this.labels = labels;
    this.scene = new Scene();
    this.scene.background = new Color(BACKGROUND);
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.eye = new PerspectiveCamera(50, 1, 0.05, 500);
    this.eye.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.eye, canvas);
    this.controls.addEventListener("change", changed);
    this._light();
    new ResizeObserver(() => { this._resize(); changed(); }).observe(canvas.parentElement);
    this._resize();
  }

  // Whether the processor draws in place of a graphics card.
  get isByProcessor() {
    const gl = this.renderer.getContext(), more = gl.getExtension("WEBGL_debug_renderer_info");
    return BY_PROCESSOR.test(gl.getParameter(more ? more.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  }

  group() {
    const group = new Group();
    this.scene.add(group);
    return group;
  }

  // How far the picture of a camera stands before it, m: small beside the distances between cameras.
  frustumDepth(cameras) {
    const centres = [...cameras.values()].map((camera) => camera.centre);
    const middle = mean(centres), size = Math.max(0.5, ...centres.map((c) => distance(c, middle)));
    const gaps = centres.map((c) => Math.min(...centres.filter((other) => other !== c).map((other) => distance(c, other)))).sort((a, b) => a - b);
    const gap = gaps[gaps.length >> 1] ?? size; // so that the pictures of neighbours stand beside each other
    return Math.min(1.2, Math.max(0.05, Math.min(0.16 * size, 0.5 * gap)));
  }

  // Look at all cameras and people.
  fit(cameras, people) {
    const centres = [...cameras.values()].map((camera) => camera.centre);
    const joints = people.flatMap((person) => Array.from(person.states.keys(), (j) => place(person, j)).filter(Boolean));
    const centre = joints.length ? mean(joints) : ahead(cameras);
    const reach = Math.max(1.3, ...joints.map((p) => 1.15 * distance(p, centre)), ...centres.map((c) => 0.55 * distance(c, centre)));
    this._floor(Math.ceil(Math.max(5, 2.5 * reach)));
    const away = reach / Math.tan((0.5 * this.eye.fov * Math.PI) / 180);
    const side = this._openSide(centres, centre);
    this.controls.target.set(centre[0], centre[1], centre[2]);
    this.eye.position.set(centre[0] + away * 0.86 * Math.cos(side), centre[1] + away * 0.86 * Math.sin(side), centre[2] + away * 0.42);
    this.controls.update();
  }

  // Look from where a camera stands.
  lookThrough(camera) {
    const [R, c] = [camera.R, camera.centre];
    this.eye.position.set(...c);
    this.controls.target.set(c[0] + 3 * R[6], c[1] + 3 * R[7], c[2] + 3 * R[8]);
    this.controls.update();
  }

  // Pixel of the page's canvas, CSS px, of a point of the world; null behind the eye.
  pixelOf(point) {
    const v = new Vector3(...point).project(this.eye);
    if (v.z > 1) return null;
    const { clientWidth: w, clientHeight: h } = this.canvas;
    return [(0.5 + 0.5 * v.x) * w, (0.5 - 0.5 * v.y) * h];
  }

  // Who is at a place on the canvas, see `pickPerson`.
  pick(x, y, people, bones) {
    return pickPerson(people, bones, (point) => this.pixelOf(point), [x, y], NEAR_PX);
  }

  draw(scene) {
    this.eye.updateMatrixWorld();
    this.renderer.render(this.scene, this.eye);
    this._label(scene);
  }

  _light() {
    this.scene.add(new HemisphereLight(0xffffff, 0x8a93a3, 2.1));
    const sun = new DirectionalLight(0xffffff, 1.1);
    sun.position.set(3, -4, 8);
    this.scene.add(sun);
  }

  _floor(metres) {
    if (this.floor) this.scene.remove(this.floor);
    this.floor = this.group();
    const fine = new GridHelper(2 * metres, 4 * metres, 0x1b222d, 0x1b222d);
    const coarse = new GridHelper(2 * metres, 2 * metres, 0x3b4a60, 0x27313f);
    coarse.position.y = 0.001;
    this.floor.add(fine, coarse);
    this.floor.rotation.x = Math.PI / 2;
  }

  // The direction, rad, in which the largest gap between cameras lies: nothing stands before the people there.
  _openSide(centres, centre) {
    const angles = centres.map((c) => Math.atan2(c[1] - centre[1], c[0] - centre[0])).sort((a, b) => a - b);
    if (!angles.length) return -1;
    let best = [0, angles[0] + Math.PI];
    angles.forEach((angle, i) => {
      const next = i + 1 < angles.length ? angles[i + 1] : angles[0] + 2 * Math.PI;
      if (next - angle > best[0]) best = [next - angle, 0.5 * (angle + next)];
    });
    return best[1];
  }

  _label(scene) {
    const wanted = [];
    for (const person of scene.instant?.people ?? []) {
      const head = [scene.facts.skeleton.head, ...person.states.keys()].find((joint) => isThere(person, joint));
      const at = head !== undefined && place(person, head);
      if (at) wanted.push({ text: `id ${person.id}`, color: cssOf(person.id), at: [at[0], at[1], at[2] + 0.22], kind: "person" });
    }
    if (scene.shows("frusta") && scene.cameras.size <= MANY) {
      for (const camera of scene.cameras.values()) wanted.push({ text: camera.name, color: "", at: camera.centre, kind: "camera" });
    }
    while (this.labels.children.length < wanted.length) this.labels.append(document.createElement("span"));
    [...this.labels.children].forEach((element, i) => {
      const item = wanted[i], pixel = item && this.pixelOf(item.at);
      element.hidden = !pixel;
      if (!pixel) return;
      element.textContent = item.text;
      element.className = item.kind;
      element.style.color = item.color;
      element.style.transform = `translate(${pixel[0].toFixed(1)}px, ${pixel[1].toFixed(1)}px) translate(-50%, -50%)`;
    });
  }

  _resize() {
    const { clientWidth: w, clientHeight: h } = this.canvas.parentElement;
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
    this.renderer.setSize(Math.max(1, w), Math.max(1, h));
    this.eye.aspect = Math.max(1, w) / Math.max(1, h);
    this.eye.updateProjectionMatrix();
  }
}

function mean(points) {
  return [0, 1, 2].map((i) => points.reduce((sum, p) => sum + p[i], 0) / Math.max(1, points.length));
}

function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

// Where cameras look to: the mean of places some metres before them.
function ahead(cameras) {
  const list = [...cameras.values()], centres = list.map((camera) => camera.centre), middle = mean(centres);
  const reach = Math.max(1, ...centres.map((c) => distance(c, middle)));
  return mean(list.map(({ centre: c, R }) => [c[0] + reach * R[6], c[1] + reach * R[7], c[2] + reach * R[8]]));
}
