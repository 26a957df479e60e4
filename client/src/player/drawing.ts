// The scene on two canvases: the road, drawn again when the view moves, and the traffic over it.
import type { Ground } from "../geometry.ts";
import type { Camera } from "./camera.ts";
import { type Agent, colorAt, type Layer, type Pose, poseAt, type Scene, waysOf } from "./scene.ts";

const TRAIL_S = 3;
const LEAST_PIXELS = 3;
const ARROW_EVERY_M = 1.4;
const STOP_LINE_M = 0.5;
const MOST_SLICES = 40;
const IN_SHADE = 0.62;

export interface Look {
  /** 0 in the light theme, 1 in the dark one. */
  theme: 0 | 1;
  ratio: number;
  chosen: string | null;
  hovered: string | null;
  compares: boolean;
}
export interface Shown {
  agent: Agent;
  pose: Pose;
}

/** Paths of layers by layer, since they are drawn in every frame of a moving view. */
const paths = new WeakMap<object, Path2D>();

function pathOf(key: object, lines: readonly Ground[][], isClosed: boolean): Path2D {
  let path = paths.get(key);
  if (!path) {
    path = new Path2D();
    for (const line of lines) {
      line.forEach(([x, y], index) => {
        if (index) path?.lineTo(x, y);
        else path?.moveTo(x, y);
      });
      if (isClosed) path.closePath();
    }
    paths.set(key, path);
  }
  return path;
}

/** Heads of arrows at the middles of lines, in driving direction. */
function arrowsOf({ lines }: Layer): Ground[][] {
  return lines.flatMap((line) => {
    const at = Math.floor(line.length / 2);
    const [from, to] = [line[at - 1], line[at]];
    if (!from) return [];
    const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    if (!length) return [];
    const [dx, dy] = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
    const tail = (side: number): Ground => [
      to[0] - ARROW_EVERY_M * dx - side * dy,
      to[1] - ARROW_EVERY_M * dy + side * dx,
    ];
    return [[tail(0.45), to, tail(-0.45)]];
  });
}

export function drawRoad(pen: CanvasRenderingContext2D, scene: Scene, camera: Camera, look: Look): void {
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.fillStyle = scene.colors.ground[look.theme];
  pen.fillRect(0, 0, pen.canvas.width, pen.canvas.height);
  pen.setTransform(...camera.matrix(look.ratio));
  const atLeast = (width: number, pixels: number) => Math.max(width, pixels / camera.scale);
  for (const layer of scene.road) {
    pen.fillStyle = pen.strokeStyle = layer.colors[look.theme];
    if (layer.isArrow) {
      if (camera.scale < 2) continue;
      pen.fill(pathOf(layer, arrowsOf(layer), true));
    } else if (layer.width) {
      pen.lineWidth = atLeast(layer.width, 0.6);
      const [on, off, begin] = layer.dash ?? [];
      pen.setLineDash(layer.dash ? [on, off] : []);
      pen.lineDashOffset = begin ?? 0;
      pen.stroke(pathOf(layer, layer.lines, false));
      pen.setLineDash([]);
    } else {
      // Each for itself: rings that overlap in opposite directions would cut holes.
      for (const ring of layer.lines) pen.fill(pathOf(ring, [ring], true), "evenodd");
    }
  }
  if (scene.original && look.compares) {
    pen.strokeStyle = scene.colors.ghost[look.theme];
    pen.lineWidth = atLeast(0.1, 1);
    pen.stroke(pathOf(scene.original, scene.original.lines, false));
  }
}

/** Draws the traffic at a step, and tells who is there. */
export function drawTraffic(
  pen: CanvasRenderingContext2D,
  scene: Scene,
  camera: Camera,
  look: Look,
  step: number,
): Shown[] {
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, pen.canvas.width, pen.canvas.height);
  const matrix = camera.matrix(look.ratio);
  pen.setTransform(...matrix);
  pen.lineCap = "butt";
  for (const { line, phases } of scene.signals) {
    pen.strokeStyle = colorAt(phases, step)[look.theme];
    pen.lineWidth = Math.max(STOP_LINE_M, 2 / camera.scale);
    stroke(pen, line);
  }
  const shown = there(scene.agents, step);
  pen.lineCap = pen.lineJoin = "round";
  for (const { agent, pose } of shown) {
    pen.strokeStyle = agent.colors[look.theme];
    const isChosen = agent.id === look.chosen;
    const to = isChosen ? scene.last : step + TRAIL_S / scene.stepS;
    pen.globalAlpha = isChosen ? 0.7 : 0.4;
    pen.lineWidth = Math.max(isChosen ? 0.4 : 0.3, 1.5 / camera.scale);
    waysOf(agent, step, to).forEach((way) => {
      const isNext = way.length && Math.hypot(way[0][0] - pose.at[0], way[0][1] - pose.at[1]) < pose.speed + 1;
      stroke(pen, isNext ? [pose.at, ...way] : way);
    });
  }
  pen.globalAlpha = 1;
  const depth = ({ pose }: Shown) => camera.pixel(pose.at)[1];
  const sorted = camera.slant ? shown.toSorted((one, other) => depth(one) - depth(other)) : shown;
  for (const one of sorted) drawAgent(pen, matrix, one, camera, look, scene);
  for (const { agent, pose } of look.compares && scene.original ? there(scene.original.agents, step) : []) {
    place(pen, matrix, pose, 0);
    pen.strokeStyle = scene.colors.ghost[look.theme];
    pen.lineWidth = Math.max(0.15, 1.5 / camera.scale);
    const [length, width] = agent.size;
    pen.strokeRect(-length / 2, -width / 2, length, width);
  }
  return shown;
}

const there = (agents: readonly Agent[], step: number): Shown[] =>
  agents.flatMap((agent) => {
    const pose = poseAt(agent, step);
    return pose ? [{ agent, pose }] : [];
  });

function stroke(pen: CanvasRenderingContext2D, line: readonly Ground[]): void {
  if (line.length < 2) return;
  pen.beginPath();
  for (const [x, y] of line) pen.lineTo(x, y);
  pen.stroke();
}

function shade(color: string): string {
  const part = (begin: number) => Math.round(IN_SHADE * Number.parseInt(color.slice(begin, begin + 2), 16));
  return `rgb(${part(1)}, ${part(3)}, ${part(5)})`;
}

/** Metres ahead and to the left of an agent, some pixels above the ground. */
function place(
  pen: CanvasRenderingContext2D,
  matrix: ReturnType<Camera["matrix"]>,
  { at, heading }: Pose,
  rise: number,
) {
  const [a, b, c, d, e, f] = matrix;
  pen.setTransform(a, b, c, d, e, f - rise);
  pen.translate(...at);
  pen.rotate(heading);
}

function drawAgent(
  pen: CanvasRenderingContext2D,
  matrix: ReturnType<Camera["matrix"]>,
  { agent, pose }: Shown,
  camera: Camera,
  look: Look,
  scene: Scene,
): void {
  const least = LEAST_PIXELS / camera.scale;
  const [length, width] = [Math.max(agent.size[0], least), Math.max(agent.size[1], least)];
  const rise = camera.rise(agent.size[2]) * look.ratio;
  const isLong = length > 1.5 * width;
  const body = (grown = 0) => {
    pen.beginPath();
    const [l, w] = [length + 2 * grown, width + 2 * grown];
    if (length > 1.3) pen.roundRect(-l / 2, -w / 2, l, w, 0.25 * w);
    else pen.ellipse(0, 0, l / 2, w / 2, 0, 0, 7);
  };
  if (agent.id === look.chosen || agent.id === look.hovered) {
    place(pen, matrix, pose, 0);
    const pixel = 1 / camera.scale;
    for (const [name, grown] of [
      ["selection_rim", 4],
      ["selection", 3],
    ] as const) {
      pen.fillStyle = scene.colors[name][look.theme];
      body(grown * pixel);
      pen.fill();
    }
  }
  const color = agent.colors[look.theme];
  pen.fillStyle = shade(color);
  // Walls are footprints on top of each other; the roof covers those behind.
  for (let part = 0; part < rise; part += Math.max(look.ratio, rise / MOST_SLICES)) {
    place(pen, matrix, pose, part);
    body();
    pen.fill();
  }
  pen.fillStyle = color;
  place(pen, matrix, pose, rise);
  body();
  pen.fill();
  if (isLong && length * camera.scale > 12) {
    // The windscreen, so that one sees which way it heads.
    pen.fillStyle = scene.colors.glass[look.theme];
    pen.globalAlpha = 0.75;
    const front = length / 2 - Math.min(0.24 * length, 1.2);
    const depth = Math.min(0.13 * length, 0.7);
    pen.beginPath();
    for (const [x, y] of [
      [front, 0.42],
      [front - depth, 0.34],
      [front - depth, -0.34],
      [front, -0.42],
    ])
      pen.lineTo(x, y * width);
    pen.fill();
    pen.globalAlpha = 1;
  }
}
