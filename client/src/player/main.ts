// The player: a page of its own, in which nobody edits. Python puts its scenes into it.
import { inWords, stepAfter } from "../clock.ts";
import { button, hasModifier, icon, isTyping, make, option, within } from "../dom.ts";
import { clamp, distance, type Ground, type Pixel } from "../geometry.ts";
import { Camera, SLANT } from "./camera.ts";
import { drawRoad, drawTraffic, type Look, type Shown } from "./drawing.ts";
import { boundsOf, poseAt, read, type Scene } from "./scene.ts";

const SPEEDS = [0.25, 0.5, 1, 2, 4];
const ZOOM_STEP = 1.25;
const TURN_PER_PIXEL = 0.006;
const MOST_SLANT = 1.3;
const CLICK_PIXELS = 5;
/** Scenes whose agents are nearer than that are on one map. */
const NEAR_M = 50;
const KEYS = [
  ["Space, K", "play or pause"],
  [", .  \u2190 \u2192", "a frame back or on; with Shift ten"],
  ["J L", "a second back or on"],
  ["F", "follow the selected agent"],
  ["N", "select the next agent"],
  ["Home", "show all"],
  ["V", "from above, or at a slant"],
  ["O", "compare with the original"],
  ["Page \u2191 \u2193", "another scene"],
  ["+ \u2212, wheel", "zoom; drag moves, with Shift turns"],
];

const entries: { name: string; data: string }[] = JSON.parse(document.getElementById("scenes")?.textContent ?? "[]");
/** Whether the first two are shown side by side, on one clock and with one view. */
const isPair = document.body.hasAttribute("data-pair");
const camera = new Camera();
const look: Look = { theme: 0, ratio: 1, chosen: null, hovered: null, compares: false };
let scene: Scene | null = null;
let other: Scene | null = null;
const otherCamera = new Camera();
let otherShown: Shown[] = [];
/** From the first one's place to the other's, for roads that lie elsewhere. */
let shift: Ground = [0, 0];
let number = 0;
let head = { step: 0, isPlaying: !matchMedia("(prefers-reduced-motion: reduce)").matches, speed: 1, loops: true };
let since = performance.now();
let shown: Shown[] = [];
let follows = false;
let isRoadOld = true;
let isTrafficOld = true;

// What is on the page.
const stage = make("main", "pd-stage", { "aria-label": "Top view of the scene" });
const [road, traffic, otherRoad, otherTraffic] = [make("canvas"), make("canvas"), make("canvas"), make("canvas")];
const otherTitle = make("h1");
const otherLabel = make("div", "pd-label", { role: "note" });
const title = make("h1");
const facts = make("p");
const credit = make("p", "pd-credit");
const labels = [make("div", "pd-label", { role: "note" }), make("div", "pd-label", { role: "note" })];
const about = make("section", "pd-about", { "aria-label": "About" });
const list = make("nav", "pd-list", { "aria-label": "Scenes" });
const playIcon = icon("M4 2.5v11l9.5-5.5z", 16);
const pauseIcon = icon("M3.5 2.5h3v11h-3z M9.5 2.5h3v11h-3z", 16);
const play = button("", "", () => setPlaying(!head.isPlaying), { title: "Play or pause (Space)" });
const time = make("output", "pd-time", { "aria-label": "Time shown" });
const slider = make("input", "", { type: "range", step: 1, "aria-label": "Time" });
const zero = make("div", "pd-zero", { title: "t = 0" });
const speed = make("select", "", { "aria-label": "Speed" });
const follow = button("", "Follow", () => setFollows(!follows), { title: "Follow the selected agent (F)" });
const slant = button("", "3-D", toggleSlant, { title: "From above, or at a slant (V)" });
const original = button("", "Original", toggleOriginal, { title: "Compare with the original (O)" });
const info = button("", "About", toggleAbout, { title: "Source and keys (?)" });

function build() {
  const top = make("header", "pd-head");
  top.append(title, facts);
  about.hidden = true;
  const beside = make("header", "pd-head");
  beside.append(otherTitle);
  const others = isPair ? [otherRoad, otherTraffic, beside, otherLabel] : [];
  stage.append(road, traffic, top, credit, ...others, ...labels, about);
  for (const value of SPEEDS) speed.append(option(value, `${value}\u00d7`));
  speed.value = "1";
  const track = make("div", "pd-track");
  track.append(slider, zero);
  const tools = make("div", "pd-tools");
  tools.append(follow, button("", "Fit", fit, { title: "Show all (Home)" }), slant, original, info);
  const bar = make("footer", "pd-bar");
  bar.append(play, time, track, speed, tools);
  entries.forEach((entry, index) => {
    list.append(button("", entry.name, () => open(index)));
  });
  list.hidden = isPair || entries.length < 2;
  document.body.append(list, stage, bar);
}

const stepNow = (): number =>
  scene
    ? stepAfter((performance.now() - since) / 1000, head, { ...scene, beginStep: begin(scene), endStep: end(scene) })
    : 0;

/** The other scene's step when the first one is at a step: both are as far from t = 0. */
const otherStep = (step: number, from: Scene, to: Scene) =>
  to.current + ((step - from.current) * from.stepS) / to.stepS;
const begin = (one: Scene) => Math.min(one.first, other ? Math.ceil(otherStep(other.first, other, one)) : one.first);
const end = (one: Scene) => Math.max(one.last, other ? Math.floor(otherStep(other.last, other, one)) : one.last);

function seek(step: number, change: Partial<typeof head> = {}) {
  head = { ...head, ...change, step: scene ? clamp(step, begin(scene), end(scene)) : 0 };
  since = performance.now();
  isTrafficOld = true;
  play.replaceChildren(head.isPlaying ? pauseIcon : playIcon);
  play.setAttribute("aria-label", head.isPlaying ? "Pause" : "Play");
}
// It stops at a frame, from which others are steps.
const setPlaying = (isPlaying: boolean) => seek(isPlaying ? stepNow() : Math.round(stepNow()), { isPlaying });
const skip = (steps: number) => seek(Math.round(stepNow()) + steps, { isPlaying: false });

function setFollows(value: boolean) {
  follows = value;
  if (follows && !look.chosen) choose(scene?.focus || shown[0]?.agent.id || null);
  pressed(follow, follows);
}
function choose(id: string | null) {
  look.chosen = id;
  if (!id && follows) setFollows(false);
  isTrafficOld = true;
}
function chooseNext() {
  const index = shown.findIndex(({ agent }) => agent.id === look.chosen);
  choose(shown[(index + 1) % shown.length]?.agent.id ?? null);
}
function toggleSlant() {
  camera.slant = camera.slant ? 0 : SLANT;
  pressed(slant, camera.slant > 0);
  isRoadOld = true;
}
function toggleOriginal() {
  look.compares = !look.compares && !original.hidden;
  pressed(original, look.compares);
  isRoadOld = true;
}
function toggleAbout() {
  about.hidden = !about.hidden;
  pressed(info, !about.hidden);
}
const pressed = (one: HTMLElement, is: boolean) => one.setAttribute("aria-pressed", String(is));

/** The view as the last fit left it: the picture may change its size after it. */
let fitted = "";
const viewNow = () => [camera.middle, camera.scale, camera.turn].join();
function fit() {
  if (!scene) return;
  setFollows(false);
  camera.fit(boundsOf(scene), { top: 64, bottom: 32, left: 16, right: 16 });
  fitted = viewNow();
  isRoadOld = true;
}

async function open(index: number) {
  number = index;
  const entry = entries[index];
  [...list.children].forEach((one, at) => {
    one.setAttribute("aria-current", String(at === index));
  });
  list.children[index]?.scrollIntoView({ block: "nearest", inline: "nearest" });
  title.textContent = entry.name;
  let found: Scene;
  try {
    found = await read(entry.data);
    if (isPair) other = await read(entries[1].data);
  } catch (error) {
    facts.textContent = `This browser cannot read the scene: ${error}`;
    return;
  }
  // Another one may have been asked for meanwhile.
  if (number !== index) return;
  scene = found;
  if (other) {
    const [here, there] = [middleOf(scene), middleOf(other)];
    shift = distance(here, there) > NEAR_M ? [there[0] - here[0], there[1] - here[1]] : [0, 0];
    otherTitle.textContent = entries[1].name;
  }
  choose(null);
  look.hovered = null;
  const [from, to] = [begin(found), end(found)];
  const duration = ((to - from) * found.stepS).toFixed(1);
  facts.textContent = [found.city, `${found.agents.length} agents`, `${duration} s`].filter(Boolean).join(" \u00b7 ");
  credit.textContent = found.attribution;
  slider.min = String(from);
  slider.max = String(to);
  zero.style.left = `${(100 * (found.current - from)) / Math.max(to - from, 1)}%`;
  original.hidden = !(found.original || other?.original);
  if (original.hidden) look.compares = false;
  pressed(original, look.compares);
  const keys = make("dl");
  for (const [key, what] of KEYS) keys.append(make("dt", "", {}, key), make("dd", "", {}, what));
  about.replaceChildren(
    ...[found.attribution, ...found.notes].filter(Boolean).map((text) => make("p", "", {}, text)),
    keys,
  );
  seek(from);
  fit();
}

/** The place of the agent that a scene is about, at t = 0. */
function middleOf(one: Scene): Ground {
  const focus = one.agents.find(({ id }) => id === one.focus);
  const [low, high] = boundsOf(one);
  return (focus && poseAt(focus, one.current)?.at) ?? [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
}

// The picture.
function resize() {
  look.ratio = window.devicePixelRatio || 1;
  const { width: whole, height } = stage.getBoundingClientRect();
  const width = isPair ? whole / 2 : whole;
  const wasFitted = viewNow() === fitted;
  [camera.width, camera.height] = [width, height];
  for (const canvas of [road, traffic, otherRoad, otherTraffic]) {
    canvas.width = Math.round(width * look.ratio);
    canvas.height = Math.round(height * look.ratio);
  }
  isRoadOld = true;
  if (wasFitted) fit();
}

function showLabel(label: HTMLElement, id: string | null, among = shown, from = camera, left0 = 0) {
  const found = among.find(({ agent }) => agent.id === id);
  label.hidden = !found;
  if (!found) return;
  const { agent, pose } = found;
  label.textContent = `${agent.id}\n${agent.kind} \u00b7 ${pose.speed.toFixed(1)} m/s`;
  const [x, y] = from.pixel(pose.at);
  const side = (agent.size[0] / 2) * camera.scale + 8;
  const left = clamp(x + Math.min(side, 40), 4, camera.width - label.offsetWidth - 4);
  const above = y - camera.rise(agent.size[2]) - Math.min(side, 40) - label.offsetHeight;
  label.style.transform = `translate(${left0 + left}px, ${clamp(above, 4, camera.height - label.offsetHeight - 4)}px)`;
}

function frame() {
  requestAnimationFrame(frame);
  if (!scene || !(head.isPlaying || isRoadOld || isTrafficOld)) return;
  const step = stepNow();
  const followed = follows && scene.agents.find(({ id }) => id === look.chosen);
  const pose = followed && poseAt(followed, step);
  if (pose) {
    camera.middle = pose.at;
    isRoadOld = true;
  }
  shown = draw(road, traffic, scene, camera, step);
  if (other) {
    Object.assign(otherCamera, camera, { middle: [camera.middle[0] + shift[0], camera.middle[1] + shift[1]] });
    otherShown = draw(otherRoad, otherTraffic, other, otherCamera, otherStep(step, scene, other));
  }
  isRoadOld = isTrafficOld = false;
  slider.value = String(step);
  const words = inWords(step - scene.current, scene);
  if (time.textContent !== words) {
    time.textContent = words;
    slider.setAttribute("aria-valuetext", words);
  }
  showLabel(labels[0], look.chosen);
  showLabel(labels[1], look.hovered === look.chosen ? null : look.hovered);
  if (other) showLabel(otherLabel, look.hovered ?? look.chosen, otherShown, otherCamera, camera.width);
}

function draw(under: HTMLCanvasElement, over: HTMLCanvasElement, of: Scene, from: Camera, step: number): Shown[] {
  const [pen, above] = [under.getContext("2d"), over.getContext("2d")];
  if (!pen || !above) return [];
  if (isRoadOld) drawRoad(pen, of, from, look);
  return drawTraffic(above, of, from, look, step);
}

/** The agent under a pixel, or so many pixels from it. */
function agentAt(pixel: Pixel, reach: number): string | null {
  const [among, from] = isOther ? [otherShown, otherCamera] : [shown, camera];
  const hits = among.flatMap(({ agent, pose: { at, heading } }) => {
    const place = from.ground([pixel[0], pixel[1] + camera.rise(agent.size[2]) / 2]);
    const [dx, dy] = [place[0] - at[0], place[1] - at[1]];
    const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
    const [along, across] = [Math.abs(dx * cos + dy * sin), Math.abs(dy * cos - dx * sin)];
    const gap = Math.hypot(Math.max(0, along - agent.size[0] / 2), Math.max(0, across - agent.size[1] / 2));
    return gap * camera.scale <= reach ? [{ id: agent.id, gap: gap + 0.01 * Math.hypot(dx, dy) }] : [];
  });
  return hits.toSorted((one, other) => one.gap - other.gap)[0]?.id ?? null;
}

// Pointers, of which two pinch.
const pointers = new Map<number, Pixel>();
let moved = 0;
/** Whether the pointer is over the other scene. */
let isOther = false;
const pixelOf = (event: MouseEvent): Pixel => {
  const { left, top } = stage.getBoundingClientRect();
  const x = event.clientX - left;
  if (!pointers.size) isOther = isPair && x >= camera.width;
  return [isOther ? x - camera.width : x, event.clientY - top];
};
const onPicture = (event: Event) => !within(event, ".pd-about");

stage.addEventListener("pointerdown", (event) => {
  if (!onPicture(event)) return;
  stage.setPointerCapture(event.pointerId);
  if (!pointers.size) moved = 0;
  pointers.set(event.pointerId, pixelOf(event));
});
stage.addEventListener("pointermove", (event) => {
  const [before, now] = [pointers.get(event.pointerId), pixelOf(event)];
  if (!before) {
    const hovered = event.pointerType === "mouse" && onPicture(event) ? agentAt(now, 4) : null;
    isTrafficOld ||= hovered !== look.hovered;
    look.hovered = hovered;
    stage.classList.toggle("pd-points", hovered !== null);
    return;
  }
  moved += distance(before, now);
  const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
  pointers.set(event.pointerId, now);
  if (moved < CLICK_PIXELS) return;
  if (other) {
    const middle = (one: Pixel): Pixel => [(one[0] + other[0]) / 2, (one[1] + other[1]) / 2];
    camera.hold(camera.ground(middle(before)), middle(now));
    camera.zoom(distance(now, other) / Math.max(distance(before, other), 1), middle(now));
  } else if (event.shiftKey || event.buttons === 2) {
    camera.turn += TURN_PER_PIXEL * (now[0] - before[0]);
    if (camera.slant) camera.slant = clamp(camera.slant - TURN_PER_PIXEL * (now[1] - before[1]), 0.05, MOST_SLANT);
  } else {
    setFollows(false);
    camera.hold(camera.ground(before), now);
  }
  isRoadOld = true;
});
for (const type of ["pointerup", "pointercancel"] as const)
  stage.addEventListener(type, (event) => {
    if (!pointers.delete(event.pointerId) || moved >= CLICK_PIXELS || type === "pointercancel") return;
    choose(agentAt(pixelOf(event), event.pointerType === "mouse" ? 4 : 14));
  });
stage.addEventListener("pointerleave", () => {
  look.hovered = null;
  isTrafficOld = true;
});
stage.addEventListener("contextmenu", (event) => event.preventDefault());
stage.addEventListener(
  "wheel",
  (event) => {
    if (!onPicture(event)) return;
    event.preventDefault();
    const pixel: Pixel = follows ? [camera.width / 2, camera.height / 2] : pixelOf(event);
    camera.zoom(1.0015 ** -(event.deltaMode ? 30 * event.deltaY : event.deltaY), pixel);
    isRoadOld = true;
  },
  { passive: false },
);

slider.addEventListener("input", () => seek(Number(slider.value), { isPlaying: false }));
speed.addEventListener("change", () => seek(stepNow(), { speed: Number(speed.value) }));

function zoom(factor: number) {
  camera.zoom(factor, [camera.width / 2, camera.height / 2]);
  isRoadOld = true;
}
function ofSet(change: number) {
  if (isPair) return;
  const index = clamp(number + change, 0, entries.length - 1);
  if (index !== number) open(index);
}
const second = () => Math.max(1, Math.round(1 / (scene?.stepS ?? 1)));
const ACTS: Record<string, (event: KeyboardEvent) => void> = {
  " ": () => setPlaying(!head.isPlaying),
  k: () => setPlaying(!head.isPlaying),
  j: () => skip(-second()),
  l: () => skip(second()),
  ",": () => skip(-1),
  ".": () => skip(1),
  arrowleft: (event) => skip(event.shiftKey ? -10 : -1),
  arrowright: (event) => skip(event.shiftKey ? 10 : 1),
  f: () => setFollows(!follows),
  n: chooseNext,
  home: fit,
  v: toggleSlant,
  o: toggleOriginal,
  pageup: () => ofSet(-1),
  pagedown: () => ofSet(1),
  "+": () => zoom(ZOOM_STEP),
  "=": () => zoom(ZOOM_STEP),
  "-": () => zoom(1 / ZOOM_STEP),
  "?": toggleAbout,
  escape: () => (about.hidden ? choose(null) : toggleAbout()),
};
window.addEventListener("keydown", (event) => {
  const act = ACTS[event.key.toLowerCase()];
  if (!act || hasModifier(event) || (isTyping(event) && event.target !== slider)) return;
  // A button that has the focus is pressed by Space.
  if (event.key === " " && within(event, "button")) return;
  event.preventDefault();
  act(event);
});

const dark = matchMedia("(prefers-color-scheme: dark)");
function setTheme() {
  look.theme = dark.matches ? 1 : 0;
  document.body.classList.toggle("pd-dark", dark.matches);
  isRoadOld = true;
}
dark.addEventListener("change", setTheme);
build();
setTheme();
new ResizeObserver(resize).observe(stage);
if (entries.length) open(0);
requestAnimationFrame(frame);
