// From the ground to pixels and back: a parallel projection, from above or at a slant.
import { clamp, type Ground, type Pixel } from "../geometry.ts";

const PIXELS_PER_M = [0.2, 200] as const;
const LEAST_SPAN_M = 20;
export const SLANT = 0.95;

export class Camera {
  /** The place in the middle of the picture. */
  middle: Ground = [0, 0];
  scale = 4;
  turn = 0;
  /** From 0, above, to a right angle, at eye level. */
  slant = 0;
  width = 1;
  height = 1;

  /** Of a canvas in metres on the ground, as its setTransform takes it. */
  matrix(ratio: number): [number, number, number, number, number, number] {
    const [cos, sin] = [Math.cos(this.turn) * this.scale, Math.sin(this.turn) * this.scale];
    const flat = Math.cos(this.slant);
    const [x, y] = this.middle;
    const [a, b, c, d] = [cos, -flat * sin, -sin, -flat * cos];
    const [e, f] = [this.width / 2 - a * x - c * y, this.height / 2 - b * x - d * y];
    return [a * ratio, b * ratio, c * ratio, d * ratio, e * ratio, f * ratio];
  }

  /** Pixels by which something rises above its place on the ground. */
  rise(height: number): number {
    return height * this.scale * Math.sin(this.slant);
  }

  pixel([x, y]: Ground): Pixel {
    const [a, b, c, d, e, f] = this.matrix(1);
    return [a * x + c * y + e, b * x + d * y + f];
  }

  ground([x, y]: Pixel): Ground {
    const [a, b, c, d, e, f] = this.matrix(1);
    const determinant = a * d - b * c;
    return [(d * (x - e) - c * (y - f)) / determinant, (a * (y - f) - b * (x - e)) / determinant];
  }

  /** Move the picture so that a place of the ground is at a pixel. */
  hold(place: Ground, pixel: Pixel): void {
    const now = this.ground(pixel);
    this.middle = [this.middle[0] + place[0] - now[0], this.middle[1] + place[1] - now[1]];
  }

  zoom(factor: number, pixel: Pixel): void {
    const place = this.ground(pixel);
    this.scale = clamp(this.scale * factor, ...PIXELS_PER_M);
    this.hold(place, pixel);
  }

  /** Show an area, with room for what lies over the edges of the picture. */
  fit([low, high]: [Ground, Ground], edges: { top: number; bottom: number; left: number; right: number }): void {
    const [width, height] = [this.width - edges.left - edges.right, this.height - edges.top - edges.bottom];
    this.turn = 0;
    const across = Math.max(high[0] - low[0], LEAST_SPAN_M);
    const up = Math.max(high[1] - low[1], LEAST_SPAN_M) * Math.cos(this.slant);
    this.scale = clamp(0.92 * Math.min(width / across, height / up), ...PIXELS_PER_M);
    const pixel: Pixel = [edges.left + width / 2, edges.top + height / 2];
    this.hold([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2], pixel);
  }
}
