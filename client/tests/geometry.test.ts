import assert from "node:assert/strict";
import { test } from "node:test";
import * as geometry from "../src/geometry.ts";

const { along, bow, clamp, distance, halfWay, head, outlineOf, roundLength, spotBeside } = geometry;
const { squareBetween } = geometry;

test("what is behind the camera leaves a gap in a line", () => {
  assert.equal(along([[0, 0], [1, 2], null, [3, 4], [5, 6]]), "M0.0 0.0L1.0 2.0M3.0 4.0L5.0 6.0");
  assert.equal(along([null, null]), "");
});

test("an arrow's head is at the last point that is seen, and needs a line", () => {
  assert.equal(head([[0, 0], [10, 0], null], 0), "M10.0 0.0L10.0 0.0L10.0 0.0");
  assert.equal(head([[10, 0]]), "");
  assert.equal(
    head([
      [10, 0],
      [11, 0],
    ]),
    "",
  );
  assert.equal(head([]), "");
});

test("a bow goes from end to end, and its middle lies above both on the screen", () => {
  for (const [from, to] of [
    [
      [0, 100],
      [80, 100],
    ],
    [
      [80, 100],
      [0, 100],
    ],
  ] as const) {
    const points = bow([...from], [...to]);
    assert.deepEqual([points[0], points.at(-1)], [from, to]);
    assert.ok(points[10][1] < 100);
  }
  assert.ok(bow([5, 5], [5, 5]).flat().every(Number.isFinite));
});

test("half way is measured along the line", () => {
  assert.deepEqual(
    halfWay([
      [0, 0],
      [4, 0],
      [4, 8],
    ]),
    [4, 2],
  );
  assert.deepEqual(halfWay([[3, 3]]), [3, 3]);
});

test("a drag spans a square from its corner, as large as it is long", () => {
  assert.deepEqual(squareBetween([0, 0], [4, -10]), [5, -5, 5]);
  const outline = outlineOf([5, -5, 5], 2);
  assert.equal(outline.length, 8);
  assert.ok(outline.every(([x, y]) => Math.max(Math.abs(x - 5), Math.abs(y + 5)) === 5));
});

test("a scale is 1, 2 or 5 times a power of ten, and the longest of these", () => {
  for (const [most, length] of [
    [1, 1],
    [4.9, 2],
    [99, 50],
    [120, 100],
    [0.7, 0.5],
  ])
    assert.ok(distance([roundLength(most), 0], [length, 0]) < 1e-9);
});

test("a label lies in the picture and on no other", () => {
  const [size, picture] = [
    { width: 40, height: 10 },
    { width: 200, height: 100 },
  ];
  const first = spotBeside([100, 50], 5, size, picture, []);
  assert.deepEqual([first.left, first.top], [105, 35]);
  const second = spotBeside([100, 50], 5, size, picture, [first]);
  assert.ok(second.left + second.width <= first.left);
  const corner = spotBeside([195, 5], 5, size, picture, []);
  assert.ok(corner.left + corner.width <= 200 && corner.top >= 0);
});

test("a value is kept between its bounds", () => {
  assert.deepEqual(
    [-2, 0.5, 9].map((value) => clamp(value, 0, 1)),
    [0, 0.5, 1],
  );
});
