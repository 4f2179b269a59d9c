// The page of the calibration guide: images with corners and covered cells, and the next step of each camera.

import { openSource } from "#view/source.js";

const GAP = 12, CAPTION = 92, LEAST = 180; // px: between images, of three lines below one, least width of an image
const $ = (id) => document.getElementById(id);
const page = { facts: null, guide: null, views: [], drawn: 0 };
window.guide = page; // for tests

const source = openSource({
  told(words) {
    if (words.type === "facts") begin(words);
    else if (words.type === "guide") show(words);
    else if (words.type === "waiting") wait(words.text);
  },
  async packet({ number, messages }) {
    await Promise.all(messages.map(({ topic, bytes }) => page.views[topic]?.take(bytes)));
    page.drawn += 1;
    source.drawn(number);
  },
});

function wait(text) {
  $("waiting").hidden = !text;
  $("waiting").firstElementChild.textContent = text ?? "";
}

function begin(facts) {
  page.facts = facts;
  page.views = facts.cameras.map((camera) => new View(camera));
  $("views").replaceChildren(...page.views.map((view) => view.figure));
  fit();
}

// Choose the number of columns with which all images are largest and fit into the window.
function fit() {
  const { clientWidth, clientHeight } = $("views"), count = page.views.length;
  if (!count) return;
  const shape = Math.max(...page.facts.cameras.map(({ size }) => size[1] / size[0]));
  const widths = page.views.map((_, k) => {
    const rows = Math.ceil(count / (k + 1));
    return Math.min(clientWidth / (k + 1) - GAP, (clientHeight / rows - GAP - CAPTION) / shape);
  });
  const width = Math.max(...widths, LEAST);
  const columns = width === LEAST ? Math.max(1, Math.floor(clientWidth / (LEAST + GAP))) : widths.indexOf(width) + 1;
  $("views").style.gridTemplateColumns = `repeat(${columns}, ${Math.floor(width)}px)`;
}
addEventListener("resize", fit);

// One camera: its newest image, corners of the board, and cells of the image.
class View {
  constructor({ name, size }) {
    this.figure = element("figure", { className: "view" });
    this.canvas = element("canvas", { width: 640, height: Math.round((640 * size[1]) / size[0]) });
    this.dot = element("span", { className: "dot" });
    this.facts = element("small");
    this.advice = element("p");
    this.image = null;
    this.corners = new Uint16Array();
    this.camera = null;
    const head = element("h2");
    head.append(this.dot, name, this.facts);
    const caption = element("figcaption");
    caption.append(head, this.advice);
    this.figure.append(this.canvas, caption);
  }

  async take(bytes) {
    const count = new DataView(bytes.buffer, bytes.byteOffset).getUint32(0, true);
    const begin = bytes.byteOffset + 4;
    this.corners = new Uint16Array(bytes.buffer.slice(begin, begin + 4 * count));
    this.image?.close();
    this.image = null;
    this.image = await createImageBitmap(new Blob([bytes.subarray(4 + 4 * count)], { type: "image/jpeg" }));
    this.draw();
  }

  tell(camera, good) {
    this.camera = camera;
    const far = camera.distances ? `${camera.distances.map((d) => d.toFixed(1)).join(" to ")} m` : "";
    this.facts.textContent = `${camera.views}/${good.views} views · ${camera.tilted} tilted ${far && "· " + far}`;
    this.advice.textContent = camera.advice || "enough";
    this.figure.classList.toggle("enough", !camera.advice);
    this.dot.className = `dot ${camera.advice ? "warn" : "good"}`;
    this.draw();
  }

  draw() {
    const { width, height } = this.canvas, pen = this.canvas.getContext("2d");
    if (this.image) pen.drawImage(this.image, 0, 0, width, height);
    else pen.clearRect(0, 0, width, height);
    const covered = this.camera?.covered ?? [];
    covered.forEach((row, y) => row.forEach((is, x) => {
      const w = width / row.length, h = height / covered.length;
      pen.fillStyle = is ? "rgba(66, 211, 146, .18)" : "rgba(255, 107, 107, .12)";
      pen.fillRect(x * w, y * h, w, h);
      pen.strokeStyle = "rgba(255, 255, 255, .25)";
      pen.strokeRect(x * w, y * h, w, h);
    }));
    pen.fillStyle = "#ffe14d";
    for (let k = 0; k < this.corners.length; k += 2) {
      pen.beginPath();
      pen.arc((this.corners[k] / 65535) * width, (this.corners[k + 1] / 65535) * height, 3.5, 0, 7);
      pen.fill();
    }
  }
}

function show(guide) {
  if (!page.facts) return;
  page.guide = guide;
  wait(null);
  guide.cameras.forEach((camera, k) => page.views[k].tell(camera, page.facts.good));
  const big = element("b", { textContent: guide.error_mm === null ? "– mm" : `${guide.error_mm.toFixed(1)} mm` });
  $("error").replaceChildren(big, guide.error);
  $("advice").textContent = guide.advice;
  $("badge").textContent = guide.enough ? "enough" : guide.usable ? "usable" : "not usable yet";
  $("badge").className = `badge ${guide.enough ? "live" : ""}`;
  $("recorded").textContent = guide.recorded;
  $("notices").replaceChildren(...guide.notices.map((text) => element("p", { className: "notice", textContent: text })));
  drawLinks(guide);
}

// Common instants of each pair of cameras.
function drawLinks({ cameras, links }) {
  const counts = new Map(links.flatMap(([a, b, count]) => [[`${a} ${b}`, count], [`${b} ${a}`, count]]));
  const head = element("tr");
  head.append(element("th"), ...cameras.map(({ name }) => element("th", { textContent: name })));
  const rows = cameras.map(({ name }, a) => {
    const row = element("tr");
    const cells = cameras.map((_, b) => {
      const count = counts.get(`${a} ${b}`);
      return element("td", { textContent: count ?? "", className: a === b ? "self" : count >= page.facts.good.links ? "good" : "" });
    });
    row.append(element("th", { textContent: name }), ...cells);
    return row;
  });
  $("links").replaceChildren(head, ...rows);
}

function element(name, words = {}) {
  return Object.assign(document.createElement(name), words);
}
