// What one element makes and others use; none of it mounts an element.
import { project } from "./bridge.ts";
import { icon, Signal } from "./dom.ts";
import { type Box, distance, type Pixel, type Place } from "./geometry.ts";

/** The agent that the pointer rests on in the picture. */
export const agentUnderPointer = new Signal<string | null>();
/** The time that is shown, in seconds from the current step on. */
export const playheadMoved = new Signal<number>();
/** The step that is shown now, from the current one on; the timeline sets it. */
export const clock = { step: (): number => 0 };
/** The track of the timeline: where a step is on it, as a share of its width. */
export const track = {
  box: null as HTMLElement | null,
  stepS: 0.1,
  share: (_step: number): number => 0,
  drawn: new Signal<void>(),
};
/** Parts of the picture that names of agents do not cover. */
export const taken: Box[] = [];

export const padlock = (): SVGSVGElement => icon("M3 7h10v7H3z M5 7V5a3 3 0 0 1 6 0v2", 16);

/** Where a circle on the ground is drawn, and its radius in pixels; null behind the camera. */
export function circle(point: Place, radius: number): { at: Pixel; radius: number } | null {
  const [x, y, z] = point;
  const at = project(point);
  const edges = [project([x, y + radius, z]), project([x + radius, y, z])];
  if (!at || !edges[0] || !edges[1]) return null;
  return { at, radius: Math.max(distance(edges[0], at), distance(edges[1], at)) };
}

/** What a canvas shows now. */
export function copyOf(source: HTMLCanvasElement, into: HTMLCanvasElement): void {
  into.width = source.width;
  into.height = source.height;
  into.getContext("2d")?.drawImage(source, 0, 0);
}
