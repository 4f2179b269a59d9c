// One colour per id, as io/colors.py gives it: the same in every picture of this project.

import { Color, SRGBColorSpace } from "#view/vendor/three.js";

const GOLDEN = 0.6180339887498949, FIRST_HUE = 0.08;

// [r, g, b] in 0..1
export function rgbOf(id) {
  const hue = (((FIRST_HUE + GOLDEN * id) % 1) + 1) % 1, s = id % 2 === 0 ? 0.85 : 0.6;
  const sector = Math.floor(hue * 6), f = hue * 6 - sector;
  const p = 1 - s, q = 1 - s * f, t = 1 - s * (1 - f);
  return [[1, t, p], [q, 1, p], [p, 1, t], [p, q, 1], [t, p, 1], [1, p, q]][sector % 6];
}

// A colour for materials, whose numbers are linear
export function colorOf(id, scale = 1) {
  return new Color().setRGB(...rgbOf(id), SRGBColorSpace).multiplyScalar(scale);
}

export function cssOf(id, alpha = 1) {
  const [r, g, b] = rgbOf(id).map((x) => Math.round(255 * x));
  return alpha === 1 ? `rgb(${r},${g},${b})` : `rgba(${r},${g},${b},${alpha})`;
}

// [r, g, b] in 0..1 of a rigid part, paler than ids; neighbours in the list differ most.
export function rgbOfPart(part) {
  return rgbOf(2 * part + 1).map((x) => 0.2 + 0.8 * x);
}

const PARTS = new Map(); // as patches are many and parts are few

export function partColor(part) {
  if (!PARTS.has(part)) PARTS.set(part, new Color().setRGB(...rgbOfPart(part), SRGBColorSpace));
  return PARTS.get(part);
}

export function partCss(part) {
  return `rgb(${rgbOfPart(part).map((x) => Math.round(255 * x))})`;
}

// Dark to bright for 0..1, for score maps and depth.
export function heat(x) {
  const c = Math.min(1, Math.max(0, x));
  return [Math.round(255 * Math.min(1, 1.6 * c)), Math.round(255 * Math.min(1, Math.max(0, 1.8 * c - 0.5))), Math.round(255 * Math.max(0, 0.55 - 1.2 * Math.abs(c - 0.35)))];
}
