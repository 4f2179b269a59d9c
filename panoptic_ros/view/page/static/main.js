// The page: what comes is put into the store, and drawn when something has changed.

import { makeCamera } from "#view/lens.js";
import { LAYERS } from "#view/layers.js";
import { Store } from "#view/store.js";
import { openSource } from "#view/source.js";
import { LIVE } from "#view/packets.js";
import { Player, SPEEDS } from "#view/player.js";
import { Blocks } from "#view/blocks.js";
import { Stage3D } from "#view/stage3d.js";
import { Tiles } from "#view/tiles.js";
import { TimeLine } from "#view/timeline.js";
import { Inspector } from "#view/inspector.js";
import { HealthPanel } from "#view/health.js";
import { drawWords } from "#view/words.js";
import { exposeForTests } from "#view/for_tests.js";

const SECOND = 1e9;
const KEPT_LIVE_S = 20;
const PATIENCE_S = 1.5; // behind images, before skeletons count as missing
const HOLD_MS = 500; // that the last picture stays after a seek, until all is there that the next one shows
const $ = (id) => document.getElementById(id);

const page = {
  facts: null, store: null, player: null, cameras: new Map(), pictures: new Map(), selected: null, health: null,
  blocks: null, holdMs: HOLD_MS, heldUntil: 0,
  shown: new Set(LAYERS.filter((layer) => layer.on).map((layer) => layer.name)),
  dirty: true, lineDirty: true, version: 0, undrawn: [], fitted: false, instant: null, drawn: 0,
};
const redraw = () => { page.dirty = page.lineDirty = true; page.version += 1; };
const stage = new Stage3D($("stage"), $("labels"), () => { page.dirty = true; });
const spaces = LAYERS.filter((layer) => layer.space).map((layer) => [layer, makeSpace(layer)]);
const flat = { willReadFrequently: stage.isByProcessor }; // without a card 2D canvases are quicker when none is imitated for them
const tiles = new Tiles($("tiles"), { flat, changed: () => { page.dirty = true; }, picked: select, looked: (camera) => { stage.lookThrough(camera); redraw(); } });
const line = new TimeLine($("timeline"), $("tip"), flat, (t) => { page.player?.seek(t); redraw(); });
const inspector = new Inspector($("inspector"), select);
const healthPanel = new HealthPanel($("health"));

function makeSpace(layer) {
  const groups = [];
  const update = layer.space({ group: () => { groups.push(stage.group()); return groups.at(-1); }, frustumDepth: (cameras) => stage.frustumDepth(cameras) });
  return (scene) => {
    for (const group of groups) group.visible = page.shown.has(layer.name);
    if (page.shown.has(layer.name)) update(scene);
  };
}

// ------------------------------------------------------------------------------- what comes

const source = openSource({
  told(words) {
    if (words.type === "presence") {
      line.setSpans(words.spans);
      page.lineDirty = true;
      return;
    }
    if (words.type === "facts") begin(words);
    else if (words.type === "health") page.health = words;
    else if (words.type === "waiting" || words.type === "problem") wait(words.text);
    if (words.type === "problem") page.blocks?.failed(words.block);
    redraw();
  },
  packet({ kind, number, messages }) {
    if (!page.store) return;
    if (kind === LIVE && goesBack(messages)) page.store = new Store(page.facts);
    for (const message of messages) {
      const preview = page.store.previewOf(message, page.store.add(message));
      if (preview && kind === LIVE) tiles.decode(preview); // while the rest is drawn
    }
    if (kind === LIVE) {
      page.undrawn.push(number);
      page.store.forget(page.store.front(PATIENCE_S * SECOND) - KEPT_LIVE_S * SECOND);
    } else {
      page.blocks.came(number);
      if (page.blocks.isWhole(page.player.t)) prepare(page.player.t);
      page.lineDirty = true;
      if (!page.blocks.matters(number, page.player.t)) return;
    }
    redraw();
  },
});

// Whether time has gone back, as where a bag is played again.
function goesBack(messages) {
  const front = page.store.front(PATIENCE_S * SECOND);
  return front !== null && messages.every((message) => page.store.timeOf(message.bytes) < front - PATIENCE_S * SECOND);
}

function begin(facts) {
  const live = facts.kind === "live";
  page.facts = facts;
  page.store = new Store(facts);
  page.player = new Player(live, 0, live ? 0 : Number(BigInt(facts.end_ns) - BigInt(facts.begin_ns)));
  page.cameras = new Map(facts.cameras.map((camera) => [camera.name, makeCamera(camera)]));
  page.blocks = new Blocks(page.player.end, (number) => source.ask(number, keys()));
  page.fitted = false;
  tiles.begin(page.cameras, facts.skeleton.bones);
  stage.fit(page.cameras, []);
  document.title = `${facts.title} – panoptic`;
  $("title").textContent = facts.title;
  showLayers();
  source.show(keys());
  wait(live ? "waiting for images and skeletons" : "reading");
}

function wait(text) {
  $("waiting").hidden = !text;
  $("waiting").firstElementChild.textContent = text ?? "";
}

function keys() {
  return LAYERS.filter((layer) => page.shown.has(layer.name)).flatMap((layer) => layer.keys);
}

// Ask for the seconds of a recording that are needed now, and forget those that are far away.
function load() {
  if (page.player.live) return;
  page.blocks.load(page.player.t);
  const kept = page.blocks.forgetFar(page.player.t);
  if (kept) page.store.forget(...kept);
}

// Decode the images of a time.
function prepare(t) {
  tiles.prepare([...page.cameras.keys()].map((name) => page.store.pairAt(name, t)));
}

// Whether the picture is to wait: after a seek for its seconds and their images, as drawing it in parts takes longer.
function holds(now) {
  const { player } = page;
  if (player.sought) page.heldUntil = now + page.holdMs;
  player.sought = false;
  if (player.live || now > page.heldUntil) return false;
  if (!page.blocks.isWhole(player.t)) return true;
  prepare(player.t);
  return tiles.waiting > 0;
}

// ------------------------------------------------------------------------------- drawing

let before = performance.now();

function frame(now) {
  requestAnimationFrame(frame);
  const elapsed = now - before;
  before = now;
  if (!page.facts) return;
  const { player } = page, t = player.t;
  load();
  player.advance(Math.min(elapsed, 250), (time) => page.blocks.isThere(time));
  if (player.following) followNewest();
  if (player.t !== t) redraw();
  if (page.dirty && !holds(now)) {
    page.dirty = false;
    page.heldUntil = 0;
    draw();
    for (const number of page.undrawn.splice(0)) source.drawn(number);
  }
  if (page.lineDirty) drawLine();
  page.lineDirty = false;
}

// Live, the newest instant; where nobody makes skeletons, the newest image.
function followNewest() {
  const t = page.store.front(PATIENCE_S * SECOND);
  if (t === null) return;
  page.player.begin = t - KEPT_LIVE_S * SECOND;
  page.player.t = page.player.end = t;
}

function draw() {
  const { store, player } = page;
  const scene = { facts: page.facts, cameras: page.cameras, store, t: player.t, instant: null, selected: page.selected, pictures: page.pictures, shows: (name) => page.shown.has(name) };
  scene.instant = page.instant = nearEnough(store.instantAt(player.t), player.t);
  const layers = LAYERS.filter((layer) => page.shown.has(layer.name));
  page.pictures = scene.pictures = tiles.draw(scene, layers, page.version);
  if (player.playing && !player.live) prepare(player.t + 0.15 * SECOND);
  if (!page.fitted && scene.instant?.people.length) { stage.fit(page.cameras, scene.instant.people); page.fitted = true; }
  for (const [, update] of spaces) update(scene);
  stage.draw(scene);
  inspector.draw(scene);
  drawWords(page, scene, tiles, healthPanel);
  if (scene.instant || page.pictures.size || page.blocks?.isThere(player.t)) { wait(null); page.drawn += 1; }
}

function nearEnough(instant, t) {
  return instant && t - instant.t < 0.5 * SECOND ? instant : null;
}

function drawLine() {
  const { player } = page;
  if (player.live) {
    const presence = new Map();
    for (const { t, people } of page.store.instants) {
      for (const { id } of people) {
        const span = presence.get(id) ?? [id, (t - player.begin) / SECOND, 0];
        span[2] = (t - player.begin) / SECOND;
        presence.set(id, span);
      }
    }
    line.setSpans([...presence.values()]);
  }
  line.draw(player.begin, player.end, player.t, player.live ? [] : page.blocks.loaded);
}

// ------------------------------------------------------------------------------- what people do

function select(what) {
  page.selected = what;
  redraw();
}

function showLayers() {
  const buttons = LAYERS.filter(isHere).map((layer) => {
    const button = document.createElement("button");
    button.textContent = layer.title;
    button.title = layer.hint;
    button.className = page.shown.has(layer.name) ? "on" : "";
    button.onclick = () => switchLayer(layer.name);
    return button;
  });
  $("layers").replaceChildren(...buttons);
}

// A layer whose topics nobody has is not offered.
function isHere(layer) {
  return layer.keys.every((key) => page.facts.topics.some(([there]) => there === key));
}

function switchLayer(name) {
  const isOff = page.shown.delete(name), layer = LAYERS.find((each) => each.name === name);
  if (!isOff) page.shown.add(name);
  if (layer.keys.length && !isOff) page.blocks.clear();
  if (layer.keys.length) source.show(keys());
  showLayers();
  redraw();
}

function step(places) {
  const instant = page.store?.stepFrom(page.player.t, places) ?? page.store?.imageFrom(page.player.t, places);
  page.player.playing = false;
  if (instant) { page.player.t = instant.t; page.player.sought = true; }
  redraw();
}

function toggleHealth() {
  $("health").hidden = !$("health").hidden;
  $("health-switch").classList.toggle("on", !$("health").hidden);
  redraw();
}

function fit() {
  stage.fit(page.cameras, page.instant?.people ?? []);
  redraw();
}

const KEYS = {
  " ": () => page.player.toggle(), ArrowLeft: () => step(-1), ArrowRight: () => step(1), f: fit, h: toggleHealth,
  "[": () => page.player.faster(-1), "]": () => page.player.faster(1), Escape: () => select(null),
  Home: () => page.player.seek(page.player.begin), End: () => page.player.seek(page.player.end),
};
addEventListener("keydown", (event) => {
  if (event.target.matches("select, input") || event.ctrlKey || event.metaKey || !page.player) return;
  if (event.shiftKey && event.key.startsWith("Arrow")) page.player.seek(page.player.t + (event.key === "ArrowLeft" ? -SECOND : SECOND));
  else if (KEYS[event.key]) KEYS[event.key]();
  else return;
  event.preventDefault();
  redraw();
});
$("play").onclick = () => { page.player.toggle(); redraw(); };
$("back").onclick = () => step(-1);
$("on").onclick = () => step(1);
$("fit").onclick = fit;
$("health-switch").onclick = toggleHealth;
$("speed").replaceChildren(...SPEEDS.map((speed) => new Option(`${speed}×`, speed)));
$("speed").onchange = () => { page.player.speed = Number($("speed").value); redraw(); };
let pressed = null;
$("stage").addEventListener("pointerdown", (event) => { pressed = [event.offsetX, event.offsetY]; });
$("stage").addEventListener("pointerup", (event) => {
  const still = pressed && Math.hypot(event.offsetX - pressed[0], event.offsetY - pressed[1]) < 4;
  if (still) select(stage.pick(event.offsetX, event.offsetY, page.instant?.people ?? [], page.facts.skeleton.bones));
});
$("divider").onpointerdown = (event) => $("divider").setPointerCapture(event.pointerId);
$("divider").onpointermove = (event) => {
  if (event.buttons) document.querySelector("main").style.setProperty("--side", `${Math.max(160, innerWidth - event.clientX)}px`);
};

exposeForTests({ page, tiles, stage, select, switchLayer, step, redraw });
requestAnimationFrame(frame);
