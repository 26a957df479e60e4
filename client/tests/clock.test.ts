import assert from "node:assert/strict";
import { test } from "node:test";
import { inWords, stepAfter, ticks } from "../src/clock.ts";

const axis = { firstStep: -50, lastStep: 59, beginStep: -50, endStep: 59, stepS: 0.1, marks: [] };
const head = { step: 0, isPlaying: true, speed: 2, loops: true };

test("the playhead runs by its speed, and stands while it is paused", () => {
  assert.equal(stepAfter(1, head, axis), 20);
  assert.equal(stepAfter(1, { ...head, isPlaying: false }, axis), 0);
});

test("at the end it begins again, or stays", () => {
  assert.equal(stepAfter(3, head, axis), -49);
  assert.equal(stepAfter(3, { ...head, loops: false }, axis), 59);
  assert.equal(stepAfter(3, head, { ...axis, beginStep: 59 }), 59);
});

test("backwards it goes on from the end, or stays at the beginning", () => {
  assert.equal(stepAfter(3, { ...head, speed: -2 }, axis), 49);
  assert.equal(stepAfter(3, { ...head, speed: -2, loops: false }, axis), -50);
});

test("all whole seconds have ticks, of long recordings some", () => {
  assert.deepEqual(ticks(axis), [-5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5]);
  const long = ticks({ ...axis, firstStep: -500, lastStep: 500 });
  assert.ok(long.length <= 26 && long.includes(0));
});

test("times have a true minus sign, but zero has none", () => {
  assert.equal(inWords(-15, axis), "\u22121.5 s");
  assert.equal(inWords(-0.01, axis), "0.0 s");
  assert.equal(inWords(-0.4, axis), "0.0 s");
});
