// Icons and shapes of guidance terms, shared by marks, drawing mode and list.
pdOverlay.guidance = (() => {
  const NAMESPACE = "http://www.w3.org/2000/svg";
  function shape(tag, name, attributes = {}) {
    const element = document.createElementNS(NAMESPACE, tag);
    if (name) element.setAttribute("class", name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return element;
  }

  function icon(kind, size = 18) {
    const svg = shape("svg", "pd-guide-icon", {
      viewBox: "0 0 20 20", width: size, height: size, "aria-hidden": "true",
    });
    svg.append(shape("path", "", { d: pdOverlay.guidanceIcons[kind] }));
    return svg;
  }

  // An icon on a round plate, around the origin.
  function plate(kind, radius = 11) {
    const group = shape("g", "pd-guide-plate");
    const inner = shape("g", "", { transform: `translate(-8 -8) scale(0.8)` });
    inner.append(shape("path", "", { d: pdOverlay.guidanceIcons[kind] }));
    group.append(shape("circle", "", { r: radius }), inner);
    return group;
  }

  // A flag whose foot is the origin. That of an offer leaves the ground beside to agents.
  function flag(isOffer = false) {
    const group = shape("g", "pd-guide-flag");
    const cloth = "M0 -29H19L14 -22.5L19 -16H0z";
    group.append(
      shape("path", "pd-guide-hit", {
        d: isOffer ? "M-6 -34H23V-12H8V6H-8V-12H-6z" : "M-9 -34H24V8H-9z",
      }),
      shape("ellipse", "pd-guide-foot", { rx: 6, ry: 3.4 }),
      shape("path", "pd-guide-halo", { d: `M0 0V-29${cloth}` }),
      shape("path", "pd-guide-cloth", { d: cloth }),
      shape("path", "pd-guide-pole", { d: "M0 0V-30" }));
    return group;
  }

  const isSeen = (point) => point !== null;
  const at = (point) => point.map((value) => value.toFixed(1)).join(" ");

  // A line through pixels; what is behind the camera leaves a gap.
  function along(pixels) {
    let path = "";
    pixels.forEach((point, index) => {
      if (!isSeen(point)) return;
      path += `${index && isSeen(pixels[index - 1]) ? "L" : "M"}${at(point)}`;
    });
    return path;
  }

  // The two sides of an arrow's head at the end of a line.
  function head(pixels, size = 9) {
    const seen = pixels.filter(isSeen);
    const tip = seen.at(-1);
    const before = seen.findLast(
      (point) => Math.hypot(tip[0] - point[0], tip[1] - point[1]) > 3);
    if (!before) return "";
    const angle = Math.atan2(tip[1] - before[1], tip[0] - before[0]);
    const side = (turn) => [
      tip[0] - size * Math.cos(angle + turn), tip[1] - size * Math.sin(angle + turn)];
    return `M${at(side(0.5))}L${at(tip)}L${at(side(-0.5))}`;
  }

  // A bow between two pixels, and its middle.
  function bow(from, to) {
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    const rise = Math.min(0.22 * Math.hypot(dx, dy), 60);
    const length = Math.hypot(dx, dy) || 1;
    const lift = [(-dy / length) * rise, (dx / length) * rise];
    // Upwards on the screen, so that bows do not cover the road between the agents.
    const sign = lift[1] > 0 ? -1 : 1;
    const knee = [0, 1].map((axis) => (from[axis] + to[axis]) / 2 + sign * lift[axis]);
    const points = Array.from({ length: 21 }, (_, step) => {
      const t = step / 20;
      return [0, 1].map((axis) => (1 - t) ** 2 * from[axis] +
        2 * t * (1 - t) * knee[axis] + t * t * to[axis]);
    });
    return { points, middle: points[10] };
  }

  return { shape, icon, plate, flag, along, head, bow };
})();
