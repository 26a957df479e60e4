// How the camera answers to the wheel, to panning and to keys.
//
// viser zooms to the middle of the picture, pans in the picture's plane, and lets the
// camera go below the ground. Here a wheel zooms to the ground under the pointer, a pan
// keeps the ground under the pointer, and what is looked at stays on the ground. Where
// the page lacks what this needs, viser's own camera gestures are left as they are.
pdOverlay.define("view", (api) => {
  const PAN_KEY = "KeyH";
  const MAX_POLAR = (85 * Math.PI) / 180;
  const LIMITS = { top: [80, 9900], space: [4, 1500] }; // m from what is looked at
  const MAX_REACH = 8; // Farther than so many camera heights, the ground is as the sky.
  const CAMERA_KEYS = /^(Key[WASDQE]|Arrow(Up|Down|Left|Right))$/;
  let isTop = null;
  let known = null;
  let isPanKeyHeld = false;
  let pan = null;
  let hasPanned = false;

  const world = () => api.viewer()?.nodeRefFromName?.[""] ?? null;

  function controls() {
    const found = api.viewer()?.cameraControl ?? null;
    if (!found || !world()) return null;
    const isCapable = ["getPosition", "getTarget", "setLookAt"].every(
      (name) => typeof found[name] === "function");
    return isCapable ? found : null;
  }

  // Which gestures viser's controls keep: turning by the left button in 3-D.
  function configure() {
    const found = controls();
    if (!found || isTop === null) return;
    known = found;
    // viser's cross where the camera turns about; it says nothing to a user.
    window.__viserTestpoints?.devSettings?.set?.({ enableOrbitCrosshair: false });
    const none = found.constructor?.ACTION?.NONE ?? 0;
    const rotate = found.constructor?.ACTION?.ROTATE ?? 1;
    found.azimuthRotateSpeed = isTop ? 0 : 1;
    found.polarRotateSpeed = isTop ? 0 : 1;
    found.maxPolarAngle = isTop ? Math.PI : MAX_POLAR;
    if (found.mouseButtons) {
      found.mouseButtons.left = isTop ? none : rotate;
      found.mouseButtons.right = none;
      found.mouseButtons.middle = none;
    }
  }

  // Position and target in metres of the scene; ``atEnd`` of a movement under way.
  function pose(found, atEnd) {
    const node = world();
    const position = api.viewer().camera.position.clone();
    const target = position.clone();
    found.getPosition(position, atEnd);
    found.getTarget(target, atEnd);
    node.worldToLocal(position);
    node.worldToLocal(target);
    return { position, target };
  }

  function look(found, { position, target }, isSmooth) {
    const node = world();
    const from = node.localToWorld(position.clone());
    const to = node.localToWorld(target.clone());
    found.setLookAt(from.x, from.y, from.z, to.x, to.y, to.z, isSmooth);
  }

  // An element that takes clicks on the picture, such as measuring, is marked as
  // pd-picture: there the view answers as on the picture itself.
  const isOnLayer = (event) => event.target?.closest?.(".pd-picture") ?? false;
  const isOnView = (event) => api.isOnPicture(event) || isOnLayer(event);

  function zoom(event) {
    const found = controls();
    if (!found || !isOnView(event)) return;
    event.preventDefault();
    event.stopPropagation();
    if (!found.enabled) return;
    const lines = event.deltaMode === 1 ? 16 : 1;
    // A pinch on a touchpad comes as a wheel with Ctrl and small steps.
    const rate = event.ctrlKey ? 0.01 : 0.0018;
    let factor = Math.exp(Math.max(-0.6, Math.min(0.6, event.deltaY * lines * rate)));
    const now = pose(found, true);
    const offset = now.position.clone().sub(now.target);
    const distance = offset.length();
    const [nearest, farthest] = isTop ? LIMITS.top : LIMITS.space;
    const wanted = Math.max(nearest, Math.min(farthest, distance * factor));
    factor = wanted / distance;
    const center = now.target.clone();
    const point = api.ground(...api.local(event));
    if (point) {
      const across = center.clone().set(point[0], point[1], 0).sub(now.target);
      // Towards the horizon a zoom would leap; it goes there by steps.
      if (!isTop && across.length() > 3 * distance) across.setLength(3 * distance);
      center.add(across);
    }
    for (const vector of [now.position, now.target])
      vector.sub(center).multiplyScalar(factor).add(center);
    look(found, now, true);
  }

  // Ground under a pixel relative to the point below the camera, cut short towards the
  // horizon; it depends on how the camera is turned and how high it is, not on where.
  function reach(event, camera) {
    const point = api.ground(...api.local(event));
    if (!point) return null;
    const across = [point[0] - camera.x, point[1] - camera.y];
    const length = Math.hypot(...across);
    const longest = MAX_REACH * Math.max(camera.z, 1);
    if (length <= longest) return across;
    return across.map((value) => (value * longest) / length);
  }

  function startPan(event) {
    if (pan) return;
    hasPanned = false;
    if (!isOnView(event)) return;
    // Where a layer takes the clicks, a drag has nothing else to do than to pan.
    const isKeyed = event.button === 0 && (isPanKeyHeld || isOnLayer(event));
    if (event.button !== 1 && event.button !== 2 && !isKeyed) return;
    const found = controls();
    if (!found || !found.enabled) return;
    if (event.button !== 2) {
      // Neither turns the camera nor selects.
      event.preventDefault();
      event.stopPropagation();
    }
    const start = pose(found, false);
    pan = {
      start, found, pointer: event.pointerId, at: api.local(event),
      grabbed: reach(event, start.position), hasMoved: false,
    };
    if (event.button !== 2 && !isOnLayer(event)) setCursor();
  }

  function movePan(event) {
    if (!pan || event.pointerId !== pan.pointer) return;
    const [x, y] = api.local(event);
    if (!pan.hasMoved && Math.hypot(x - pan.at[0], y - pan.at[1]) < 4) return;
    if (!pan.hasMoved) {
      pan.hasMoved = true;
      setCursor();
    }
    const now = reach(event, pose(pan.found, false).position);
    if (!now || !pan.grabbed) return;
    const moved = {
      position: pan.start.position.clone(), target: pan.start.target.clone(),
    };
    for (const vector of [moved.position, moved.target]) {
      vector.x += pan.grabbed[0] - now[0];
      vector.y += pan.grabbed[1] - now[1];
    }
    look(pan.found, moved, false);
  }

  function endPan(event) {
    if (!pan || event.pointerId !== pan.pointer) return;
    hasPanned = pan.hasMoved;
    pan = null;
    setCursor();
  }

  function setCursor() {
    document.body.classList.toggle("pd-can-pan", isPanKeyHeld && !pan);
    document.body.classList.toggle("pd-pans", pan !== null);
  }

  function isTyping(event) {
    return /^(INPUT|TEXTAREA|SELECT)$/.test(event.target?.tagName ?? "");
  }

  function keyDown(event) {
    if (isTyping(event)) return;
    if (event.code === PAN_KEY && !event.ctrlKey && !event.metaKey && !event.altKey) {
      isPanKeyHeld = true;
      setCursor();
    }
    // viser moves the camera while one of these is held. It believes the key was let
    // go at once; its hot keys, which look at presses only, are not touched.
    if (CAMERA_KEYS.test(event.code))
      document.dispatchEvent(new KeyboardEvent("keyup", { code: event.code }));
  }

  function letKeysGo(event) {
    if (event.type === "keyup" && event.code !== PAN_KEY) return;
    isPanKeyHeld = false;
    setCursor();
  }

  // Near and far plane hold what the view shows, which keeps the layers of the road
  // apart in the depth buffer, close by and from far above.
  function fitDepth(camera) {
    const found = controls();
    if (!found || isTop === null) return;
    if (known && found !== known) configure();
    const { position, target } = pose(found, false);
    const distance = position.distanceTo(target);
    const near = isTop
      ? Math.max(1, distance * 0.5)
      : Math.max(0.3, 0.5 * (position.z - 4));
    const far = isTop ? distance * 1.5 + 100 : Math.max(3000, 6 * distance);
    const isClose = (a, b) => Math.abs(a - b) <= 0.05 * b;
    if (isClose(camera.near, near) && isClose(camera.far, far)) return;
    camera.near = near;
    camera.far = far;
    camera.updateProjectionMatrix();
    api.viewer().requestRender?.();
  }

  api.listen(window, "wheel", zoom, { capture: true, passive: false });
  api.listen(window, "pointerdown", startPan, { capture: true });
  api.listen(window, "pointermove", movePan, { capture: true });
  api.listen(window, "pointerup", endPan, { capture: true });
  api.listen(window, "pointercancel", endPan, { capture: true });
  // The end of a pan is neither a click nor a call for a menu.
  for (const type of ["click", "contextmenu"])
    api.listen(window, type, (event) => {
      if (!hasPanned || !isOnView(event)) return;
      hasPanned = false;
      api.take(event);
    }, { capture: true });
  api.listen(window, "keydown", keyDown);
  api.listen(window, "keyup", letKeysGo);
  api.listen(window, "blur", letKeysGo);
  api.onView(fitDepth);
  api.onDispose(() => document.body.classList.remove("pd-can-pan", "pd-pans"));

  return (state) => {
    isTop = state.isTop;
    // A new pose comes in parts, in the messages after this one. Half way there the
    // camera may be anywhere; it is kept above the ground when it has arrived.
    const found = controls();
    if (found) found.maxPolarAngle = Math.PI;
    known = null;
    requestAnimationFrame(() => requestAnimationFrame(configure));
  };
});
