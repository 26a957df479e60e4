import assert from "node:assert/strict";
import { test } from "node:test";
import { Camera } from "../src/player/camera.ts";
import { colorAt, poseAt, unpacked, waysOf } from "../src/player/scene.ts";

const camera = (changes: Partial<Camera>) => Object.assign(new Camera(), { width: 800, height: 600 }, changes);
const near = (one: readonly number[], other: readonly number[]) =>
  one.forEach((value, index) => {
    assert.ok(Math.abs(value - other[index]) < 1e-6, `${one} is not ${other}`);
  });

test("pixels and the ground are inverse, at any turn and slant", () => {
  const one = camera({ middle: [20, -7], turn: 0.7, slant: 1.1, scale: 3 });
  near(one.pixel(one.ground([123, 456])), [123, 456]);
  near(one.pixel([20, -7]), [400, 300]);
  const place = one.ground([50, 60]);
  one.zoom(1.7, [50, 60]);
  near(one.ground([50, 60]), place);
});

test("what is fitted is in the picture, between the edges", () => {
  for (const slant of [0, 0.9]) {
    const one = camera({ slant });
    one.fit([[-300, 10], [100, 40]], { top: 50, bottom: 20, left: 10, right: 30 }); // biome-ignore format: a box
    for (const corner of [
      [-300, 10],
      [100, 40],
    ] as [number, number][]) {
      // biome-ignore format: two corners
      const [x, y] = one.pixel(corner);
      assert.ok(x > 10 && x < 770 && y > 50 && y < 580);
    }
  }
});

const packed = {
  name: "", city: "", attribution: "", notes: [], stepS: 0.1, current: 1, first: 0, last: 5, focus: "",
  colors: { ground: ["", ""], glass: ["", ""], ghost: ["", ""], selection: ["", ""], selection_rim: ["", ""] },
  road: [], signals: [], original: null,
  agents: [{ id: "a", kind: "car", colors: ["", ""], size: [460, 190, 160], runs: [[0, [100, 50], [0, 0], [3100, 100], [0, 0]], [4, [900], [0], [0], [0]]] }],
} as const satisfies unknown; // biome-ignore format: a table

test("an agent moves between its steps, and is away in a gap", () => {
  const [agent] = unpacked(structuredClone(packed) as never).agents;
  assert.deepEqual(agent.size, [4.6, 1.9, 1.6]);
  near(poseAt(agent, 0.5)?.at ?? [], [1.25, 0]);
  near([poseAt(agent, 1)?.heading ?? 0], [3.2]);
  assert.equal(poseAt(agent, -0.1), null);
  assert.equal(poseAt(agent, 2), null);
  near(poseAt(agent, 4)?.at ?? [], [9, 0]);
  assert.equal(poseAt(agent, 4.5), null);
  assert.deepEqual(waysOf(agent, 1, 5), [[[1.5, 0]], [[9, 0]]]);
});

test("a colour holds until the next one", () => {
  const phases = [[0, ["a", "b"]], [30, ["c", "d"]]] as never; // biome-ignore format: a table
  assert.deepEqual(colorAt(phases, 29.9), ["a", "b"]);
  assert.deepEqual(colorAt(phases, 30), ["c", "d"]);
});
