// How the camera answers to the wheel, to panning and to keys.
//
// viser zooms to the middle of the picture, pans in the picture's plane, and lets the
// camera go below the ground. Here a wheel zooms to the ground under the pointer, a pan
// keeps the ground under the pointer, and what is looked at stays on the ground. Where
// the page lacks what this needs, viser's own camera gestures are left as they are.
import * as viser from "../bridge.ts";
import { hasModifier, isTyping, within } from "../dom.ts";
import { define, hearFirst, isOnPicture, listen, local, markBody, onDispose, onView, take } from "../frame.ts";
import { clamp, type Ground, type Pixel } from "../geometry.ts";

const PAN_KEY = "KeyH";
const MAX_POLAR = (85 * Math.PI) / 180;
const LIMITS = { top: [80, 9900], space: [4, 1500] } as const; // m from what is looked at
const MAX_REACH = 8; // Farther than so many camera heights, the ground is as the sky.

interface Pose {
  position: viser.Vector;
  target: viser.Vector;
}
interface Pan {
  start: Pose;
  found: viser.Controls;
  pointer: number;
  at: Pixel;
  grabbed: Ground | null;
  hasMoved: boolean;
}

define("view", () => {
  let isTop: boolean | null = null;
  let known: viser.Controls | null = null;
  let isPanKeyHeld = false;
  let pan: Pan | null = null;
  let hasPanned = false;

  function configure() {
    const found = viser.controls();
    if (!found || isTop === null) return;
    known = found;
    viser.keepGestures(found, !isTop);
    found.maxPolarAngle = isTop ? Math.PI : MAX_POLAR;
  }

  // Position and target in metres of the scene; `atEnd` of a movement under way.
  function pose(found: viser.Controls, camera: viser.Camera, atEnd: boolean): Pose {
    const [position, target] = [camera.position.clone(), camera.position.clone()];
    found.getPosition(position, atEnd);
    found.getTarget(target, atEnd);
    return { position: viser.toScene(position), target: viser.toScene(target) };
  }

  function look(found: viser.Controls, { position, target }: Pose, isSmooth: boolean) {
    const [from, to] = [viser.toWorld(position.clone()), viser.toWorld(target.clone())];
    found.setLookAt(from.x, from.y, from.z, to.x, to.y, to.z, isSmooth);
  }

  // An element that takes clicks on the picture, such as measuring, is marked as
  // pd-picture: there the view answers as on the picture itself.
  const isOnLayer = (event: Event) => within(event, ".pd-picture") !== null;
  const isOnView = (event: Event) => isOnPicture(event) || isOnLayer(event);

  function zoom(event: WheelEvent) {
    const [found, camera] = [viser.controls(), viser.camera()];
    if (!found || !camera || !isOnView(event)) return;
    event.preventDefault();
    event.stopPropagation();
    if (!found.enabled) return;
    const lines = event.deltaMode === 1 ? 16 : 1;
    // A pinch on a touchpad comes as a wheel with Ctrl and small steps.
    const rate = event.ctrlKey ? 0.01 : 0.0018;
    const now = pose(found, camera, true);
    const distance = now.position.distanceTo(now.target);
    const [nearest, farthest] = isTop ? LIMITS.top : LIMITS.space;
    const asked = Math.exp(clamp(event.deltaY * lines * rate, -0.6, 0.6));
    const factor = clamp(distance * asked, nearest, farthest) / distance;
    const center = now.target.clone();
    const point = viser.ground(...local(event));
    if (point) {
      const across = center.clone().set(point[0], point[1], 0).sub(now.target);
      // Towards the horizon a zoom would leap; it goes there by steps.
      if (!isTop && across.length() > 3 * distance) across.setLength(3 * distance);
      center.add(across);
    }
    for (const vector of [now.position, now.target]) vector.sub(center).multiplyScalar(factor).add(center);
    look(found, now, true);
  }

  // Ground under a pixel relative to the point below the camera, cut short towards the
  // horizon; it depends on how the camera is turned and how high it is, not on where.
  function reach(at: Pixel, eye: viser.Vector): Ground | null {
    const point = viser.ground(...at);
    if (!point) return null;
    const across: Ground = [point[0] - eye.x, point[1] - eye.y];
    const share = (MAX_REACH * Math.max(eye.z, 1)) / Math.hypot(...across);
    return share >= 1 ? across : [across[0] * share, across[1] * share];
  }

  function startPan(event: PointerEvent) {
    if (pan) return;
    hasPanned = false;
    if (!isOnView(event)) return;
    // Where a layer takes the clicks, a drag has nothing else to do than to pan.
    const isKeyed = event.button === 0 && (isPanKeyHeld || isOnLayer(event));
    if (event.button !== 1 && event.button !== 2 && !isKeyed) return;
    const [found, camera] = [viser.controls(), viser.camera()];
    if (!found?.enabled || !camera) return;
    if (event.button !== 2) {
      // Neither turns the camera nor selects.
      event.preventDefault();
      event.stopPropagation();
    }
    const [start, at] = [pose(found, camera, false), local(event)];
    const grabbed = reach(at, start.position);
    pan = { start, found, pointer: event.pointerId, at, grabbed, hasMoved: false };
    if (event.button !== 2 && !isOnLayer(event)) setCursor();
  }

  function movePan(event: PointerEvent) {
    const camera = viser.camera();
    if (!pan || !camera || event.pointerId !== pan.pointer) return;
    const at = local(event);
    if (!pan.hasMoved && Math.hypot(at[0] - pan.at[0], at[1] - pan.at[1]) < 4) return;
    if (!pan.hasMoved) {
      pan.hasMoved = true;
      setCursor();
    }
    const now = reach(at, pose(pan.found, camera, false).position);
    if (!now || !pan.grabbed) return;
    const moved = { position: pan.start.position.clone(), target: pan.start.target.clone() };
    for (const vector of [moved.position, moved.target]) {
      vector.x += pan.grabbed[0] - now[0];
      vector.y += pan.grabbed[1] - now[1];
    }
    look(pan.found, moved, false);
  }

  function endPan(event: PointerEvent) {
    if (!pan || event.pointerId !== pan.pointer) return;
    hasPanned = pan.hasMoved;
    pan = null;
    setCursor();
  }

  function setCursor() {
    markBody("pd-can-pan", isPanKeyHeld && !pan);
    markBody("pd-pans", pan !== null);
  }

  function holdPanKey(isHeld: boolean) {
    isPanKeyHeld = isHeld;
    setCursor();
  }

  // Near and far plane hold what the view shows, which keeps the layers of the road
  // apart in the depth buffer, close by and from far above.
  function fitDepth(camera: viser.Camera) {
    const found = viser.controls();
    if (!found || isTop === null) return;
    if (known && found !== known) configure();
    const { position, target } = pose(found, camera, false);
    const distance = position.distanceTo(target);
    const near = isTop ? Math.max(1, distance * 0.5) : Math.max(0.3, 0.5 * (position.z - 4));
    const far = isTop ? distance * 1.5 + 100 : Math.max(3000, 6 * distance);
    const isClose = (a: number, b: number) => Math.abs(a - b) <= 0.05 * b;
    if (isClose(camera.near, near) && isClose(camera.far, far)) return;
    camera.near = near;
    camera.far = far;
    camera.updateProjectionMatrix();
    viser.requestRender();
  }

  hearFirst("wheel", zoom, { passive: false });
  hearFirst("pointerdown", startPan);
  hearFirst("pointermove", movePan);
  hearFirst("pointerup", endPan);
  hearFirst("pointercancel", endPan);
  // The end of a pan is neither a click nor a call for a menu.
  for (const type of ["click", "contextmenu"] as const)
    hearFirst(type, (event) => {
      if (!hasPanned || !isOnView(event)) return;
      hasPanned = false;
      take(event);
    });
  listen(window, "keydown", (event) => {
    if (isTyping(event)) return;
    if (event.code === PAN_KEY && !hasModifier(event)) holdPanKey(true);
    // viser's hot keys, which look at presses only, are not touched.
    viser.letKeyGo(event);
  });
  listen(window, "keyup", (event) => {
    if (event.code === PAN_KEY) holdPanKey(false);
  });
  listen(window, "blur", () => holdPanKey(false));
  onView(fitDepth);
  onDispose(() => document.body.classList.remove("pd-can-pan", "pd-pans"));

  return (state) => {
    isTop = state.isTop;
    // A new pose comes in parts, in the messages after this one. Half way there the
    // camera may be anywhere; it is kept above the ground when it has arrived.
    const found = viser.controls();
    if (found) {
      found.maxPolarAngle = Math.PI;
      // At once: a drag that has begun, or begins before that, must not tilt the top view.
      viser.keepGestures(found, !isTop);
    }
    known = null;
    requestAnimationFrame(() => requestAnimationFrame(configure));
  };
});
