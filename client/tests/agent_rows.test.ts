import assert from "node:assert/strict";
import { test } from "node:test";
import { arranged, type Filter, nextOrder } from "../src/agent_rows.ts";
import type { AgentsState } from "../src/messages.ts";

const kinds: AgentsState["kinds"] = [
  ["vehicle", "red"],
  ["pedestrian", "blue"],
];
const rows: AgentsState["rows"] = [
  ["a10", 0, 5, 30, 1, true],
  ["a9", 1, null, null, 4, false],
  ["AV", 0, 0, 8, 2, false],
];
const all: Filter = { words: "", moving: false, new: false, kind: -1 };
const asRecorded = { column: -1, isDown: false };
const shown = (filter: Partial<Filter>, order = asRecorded) => arranged(rows, kinds, { ...all, ...filter }, order);

test("agents are found by id, kind and role, whatever the case", () => {
  assert.deepEqual(shown({ words: "av" }), [2]);
  assert.deepEqual(shown({ words: "  VEHICLE  " }), [0, 2]);
  assert.deepEqual(shown({ words: "vehicle focal" }), [0]);
  assert.deepEqual(shown({ words: "ego" }), [2]);
  assert.deepEqual(shown({ words: "nobody" }), []);
});

test("filters hold together", () => {
  assert.deepEqual(shown({ moving: true }), [0]);
  assert.deepEqual(shown({ new: true }), [1]);
  assert.deepEqual(shown({ kind: 0, new: true }), []);
});

test("ids are sorted as people count, and unknown numbers come last", () => {
  assert.deepEqual(shown({}, { column: 0, isDown: false }), [1, 0, 2]);
  assert.deepEqual(shown({}, { column: 3, isDown: false }), [2, 0, 1]);
  assert.deepEqual(shown({}, { column: 4, isDown: false }), [1, 2, 0]);
});

test("the third click takes the order of the recording", () => {
  let order = nextOrder(asRecorded, 2);
  assert.deepEqual(order, { column: 2, isDown: false });
  order = nextOrder(order, 2);
  assert.deepEqual(order, { column: 2, isDown: true });
  assert.deepEqual(nextOrder(order, 2), asRecorded);
  assert.deepEqual(nextOrder(order, 0), { column: 0, isDown: false });
});
