// A scene of the page, as Python's scene_data writes it; without the page.
import type { Ground } from "../geometry.ts";

/** In the light theme, and in the dark one. */
export type Colors = readonly [string, string];
interface Packed {
  name: string;
  city: string;
  attribution: string;
  notes: string[];
  stepS: number;
  current: number;
  first: number;
  last: number;
  colors: Record<"ground" | "glass" | "ghost" | "selection" | "selection_rim", Colors>;
  road: { colors: Colors; lines: number[][]; width?: number; dash?: number[]; isArrow?: boolean }[];
  signals: { line: number[]; phases: [number, Colors][] }[];
  agents: PackedAgent[];
  focus: string;
  original: { lines: number[][]; agents: PackedAgent[] } | null;
}
interface PackedAgent {
  id: string;
  kind: string;
  colors: Colors;
  size: [number, number, number];
  runs: [number, number[], number[], number[], number[]][];
}

export interface Run {
  first: number;
  columns: number[][];
}
/** In metres and radians; runs have x, y, heading and speed of each step. */
export interface Agent extends Omit<PackedAgent, "runs"> {
  runs: Run[];
}
export interface Layer extends Omit<Packed["road"][number], "lines"> {
  lines: Ground[][];
}
export interface Scene extends Omit<Packed, "road" | "signals" | "agents" | "original"> {
  road: Layer[];
  signals: { line: Ground[]; phases: [number, Colors][] }[];
  agents: Agent[];
  original: { lines: Ground[][]; agents: Agent[] } | null;
}
export interface Pose {
  at: Ground;
  heading: number;
  speed: number;
}

const SCALES = [100, 100, 1000, 100];

function summed(changes: readonly number[], scale: number): number[] {
  let sum = 0;
  return changes.map((change) => {
    sum += change;
    return sum / scale;
  });
}

function line(changes: readonly number[]): Ground[] {
  let [x, y] = [0, 0];
  return Array.from({ length: changes.length / 2 }, (_, index) => {
    x += changes[2 * index];
    y += changes[2 * index + 1];
    return [x / SCALES[0], y / SCALES[1]];
  });
}

const agentOf = (packed: PackedAgent): Agent => ({
  ...packed,
  size: [packed.size[0] / 100, packed.size[1] / 100, packed.size[2] / 100],
  runs: packed.runs.map(([first, ...columns]) => ({
    first,
    columns: columns.map((column, index) => summed(column, SCALES[index])),
  })),
});

export function unpacked(packed: Packed): Scene {
  const { original } = packed;
  return {
    ...packed,
    road: packed.road.map((layer) => ({ ...layer, lines: layer.lines.map(line) })),
    signals: packed.signals.map((signal) => ({ ...signal, line: line(signal.line) })),
    agents: packed.agents.map(agentOf),
    original: original && { lines: original.lines.map(line), agents: original.agents.map(agentOf) },
  };
}

export async function read(base64: string): Promise<Scene> {
  const bytes = Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
  const inflated = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return unpacked(await new Response(inflated).json());
}

/** Where an agent is at a step or between two; null where it is not there. */
export function poseAt({ runs }: Agent, step: number): Pose | null {
  const run = runs.findLast(({ first }) => first <= step);
  if (!run) return null;
  const last = run.columns[0].length - 1;
  if (step - run.first > last) return null;
  const index = Math.floor(step - run.first);
  const share = step - run.first - index;
  const [x, y, heading, speed] = run.columns.map(
    (column) => column[index] + share * (column[Math.min(index + 1, last)] - column[index]),
  );
  return { at: [x, y], heading, speed };
}

/** The way of an agent between two steps; each run is a part of it. */
export function waysOf({ runs }: Agent, from: number, to: number): Ground[][] {
  return runs.map(({ first, columns: [x, y] }) => {
    const inside = x.map((_, index) => index).filter((index) => first + index >= from && first + index <= to);
    return inside.map((index) => [x[index], y[index]]);
  });
}

export function colorAt(phases: readonly [number, Colors][], step: number): Colors {
  return (phases.findLast(([first]) => first <= step + 1e-6) ?? phases[0])[1];
}

/** Least and largest coordinates of what is worth seeing: the agents, else the road. */
export function boundsOf(scene: Scene): [Ground, Ground] {
  const places = scene.agents.flatMap((agent) => waysOf(agent, scene.first, scene.last).flat());
  const points = places.length ? places : scene.road.flatMap((layer) => layer.lines.flat());
  const low: Ground = [Infinity, Infinity];
  const high: Ground = [-Infinity, -Infinity];
  for (const point of points.length ? points : [[0, 0] as Ground])
    for (const axis of [0, 1]) {
      low[axis] = Math.min(low[axis], point[axis]);
      high[axis] = Math.max(high[axis], point[axis]);
    }
  return [low, high];
}
