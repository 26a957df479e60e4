// Lines and places, without the page: pixels of the picture, and metres of the scene.
export type Pixel = [number, number];
export type Ground = Pixel;
/** On the ground, or at a height. */
export type Point = readonly [number, number] | readonly [number, number, number];
export type Place = [number, number, number];
export type Ray = [Place, Place];
/** Middle and half of a side. */
export type Square = [number, number, number];
type Pixels = readonly (Pixel | null)[];

export const distance = (a: Point, b: Point): number => Math.hypot(a[0] - b[0], a[1] - b[1]);
export const clamp = (value: number, low: number, high: number): number => Math.min(Math.max(value, low), high);
export const isSeen = <Thing>(point: Thing | null): point is Thing => point !== null;
const between = (a: Point, b: Point, share: number): Pixel => [
  a[0] + share * (b[0] - a[0]),
  a[1] + share * (b[1] - a[1]),
];
const written = (point: Pixel): string => point.map((value) => value.toFixed(1)).join(" ");

/** A line through pixels as SVG; what is behind the camera leaves a gap. */
export function along(pixels: Pixels): string {
  return pixels.map((point, index) => point && `${index && pixels[index - 1] ? "L" : "M"}${written(point)}`).join("");
}

/** The two sides of an arrow's head at the end of a line. */
export function head(pixels: Pixels, size = 9): string {
  const seen = pixels.filter(isSeen);
  const tip = seen.at(-1);
  const before = tip && seen.findLast((point) => distance(tip, point) > 3);
  if (!before) return "";
  const angle = Math.atan2(tip[1] - before[1], tip[0] - before[0]);
  const side = (turn: number): Pixel => [
    tip[0] - size * Math.cos(angle + turn),
    tip[1] - size * Math.sin(angle + turn),
  ];
  return `M${written(side(0.5))}L${written(tip)}L${written(side(-0.5))}`;
}

/** A bow between two pixels; upwards, so that it does not cover the road between them. */
export function bow(from: Pixel, to: Pixel): Pixel[] {
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
  const length = Math.hypot(dx, dy);
  const rise = Math.min(0.22 * length, 60) / (length || 1);
  const sign = dx > 0 ? -1 : 1;
  const middle = between(from, to, 0.5);
  const knee: Pixel = [middle[0] - sign * dy * rise, middle[1] + sign * dx * rise];
  return Array.from({ length: 21 }, (_, step) => {
    const t = step / 20;
    return between(between(from, knee, t), between(knee, to, t), t);
  });
}

/** The point half way along a line. */
export function halfWay(pixels: readonly Pixel[]): Pixel {
  const steps = pixels.slice(1).map((point, index) => distance(point, pixels[index]));
  let rest = steps.reduce((sum, step) => sum + step, 0) / 2;
  const index = steps.findIndex((step) => {
    rest -= step;
    return rest <= 0;
  });
  if (index < 0) return pixels[0];
  return between(pixels[index], pixels[index + 1], 1 + rest / (steps[index] || 1));
}

/** The square that a drag spans from corner to corner. */
export function squareBetween(from: Ground, to: Ground): Square {
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
  const half = Math.max(Math.abs(dx), Math.abs(dy)) / 2;
  return [from[0] + (dx < 0 ? -half : half), from[1] + (dy < 0 ? -half : half), half];
}

/** The outline of a square, in so many parts of each side. */
export function outlineOf([x, y, half]: Square, parts: number): Ground[] {
  const corners: Ground[] = [
    [x - half, y - half],
    [x + half, y - half],
    [x + half, y + half],
    [x - half, y + half],
  ];
  return corners.flatMap((from, index) =>
    Array.from({ length: parts }, (_, part) => between(from, corners[(index + 1) % 4], part / parts)),
  );
}

/** 1, 2 or 5 times a power of ten, at most `most`. */
export function roundLength(most: number): number {
  const power = 10 ** Math.floor(Math.log10(most));
  return (most >= 5 * power ? 5 : most >= 2 * power ? 2 : 1) * power;
}

export interface Box {
  left: number;
  top: number;
  width: number;
  height: number;
}
export interface Spot extends Box {
  side: number;
  rise: number;
}

/** Beside a circle, right or left, above or below: in the picture, and on no other box. */
export function spotBeside(
  [x, y]: Pixel,
  reach: number,
  { width, height }: { width: number; height: number },
  picture: { width: number; height: number },
  placed: readonly Box[],
): Spot {
  const spots = [
    [1, -1],
    [-1, -1],
    [1, 1],
    [-1, 1],
  ].map(([side, rise]) => {
    const left = side > 0 ? x + reach : x - reach - width;
    const top = rise < 0 ? y - reach - height : y + reach;
    const outside =
      Math.max(0, -left) +
      Math.max(0, left + width - picture.width) +
      Math.max(0, -top) +
      Math.max(0, top + height - picture.height);
    const hits = placed.filter(
      (other) =>
        left < other.left + other.width &&
        other.left < left + width &&
        top < other.top + other.height &&
        other.top < top + height,
    );
    const cost = outside + 1000 * hits.length;
    return { spot: { left, top, width, height, side, rise }, cost };
  });
  return spots.reduce((best, one) => (one.cost < best.cost ? one : best)).spot;
}
