// The status chip, bottom right above the timeline, and the list that it opens upwards.
// The chip keeps its place and size whatever it says; the open list only grows.
pdOverlay.define("status", (api) => {
  const { make } = api;
  const SVG = "http://www.w3.org/2000/svg";
  const ICONS = {
    collision: "M2 6h6v5H2zM9 4l6-1 1 5-6 1zM11.5 11.5l1 2M14 11l2 1M9 12.5l-1 2",
    road: "M6 2 3 16M12 2l3 14M9 3v3M9 8v3M9 13v3",
    speed: "M3 13a7 7 0 1 1 12 0M9 12l4-5",
    against: "M6 15V3M3 6l3-3 3 3M12 3v12M9 12l3 3 3-3",
    goal: "M5 16V3h8l-2 3 2 3H5",
    beyond: "M5 2 3 16M11 2l2 14M8 3v2M8 7v1M5 11h6M15 5l2 3-2 3",
    past: "M9 4v5l3 2M3 9a6 6 0 1 0 2-4.5M3 3v3h3",
    bend: "M4 16c0-7 10-4 10-13M8 16c0-5 10-3 10-13",
  };
  const isFolded = { new: false, notices: true, ignored: true, recorded: true };
  let isOpen = false;
  let state = { groups: [], active: null };

  const button = (parent, className, label, action) => {
    const element = make("button", className, { type: "button" }, label);
    element.addEventListener("click", action);
    parent.appendChild(element);
    return element;
  };

  const unsaved = make("div", "pd-solid pd-unsaved", { role: "alert" });
  const unsavedText = make("span", "pd-clipped");
  unsaved.appendChild(unsavedText);
  button(unsaved, "pd-strong", "Download", () => api.send({ kind: "download" }));

  const list = make("div", "pd-solid pd-problems", {
    role: "dialog", "aria-label": "Problems",
  });
  const rows = make("div", "pd-problem-rows");
  const detail = make("div", "pd-problem-detail");
  const sentence = make("div", "pd-problem-sentence", { role: "status" });
  const cures = make("div", "pd-problem-cures");
  detail.append(sentence, cures);
  list.append(rows, detail);

  const chip = make("div", "pd-solid pd-chip");
  const main = button(chip, "pd-chip-main", "", () => { toggle(!isOpen); });
  const dot = make("span", "pd-dot");
  const text = make("span", "pd-clipped", { role: "status", "aria-label": "Status" });
  const caret = make("span", "pd-caret", {}, "\u25b4");
  main.append(dot, text, caret);
  const use = button(chip, "pd-strong", "", () => api.send({ kind: "use" }));
  const cancel = button(chip, "pd-strong", "Cancel", () =>
    api.send({ kind: "cancel" }));
  const bar = make("div", "pd-progress", {
    role: "progressbar", "aria-label": "Progress", "aria-valuemin": "0",
    "aria-valuemax": "100",
  });
  chip.appendChild(bar);
  api.box.append(list, unsaved, chip);

  // The share of the picture's width that the list leaves free at its left.
  const free = () => {
    const whole = api.root.getBoundingClientRect();
    if (!isOpen || !whole.width) return 1;
    const share = (list.getBoundingClientRect().left - whole.left) / whole.width;
    return Math.min(Math.max(share, 0), 1);
  };
  const choose = (id) => api.send({ kind: "choose", value: id, free: free() });

  // The list is as high as its lines, and lower only when it is opened again.
  let mostLines = 0;
  function fit() {
    mostLines = Math.max(mostLines, rows.childElementCount);
    list.style.setProperty("--pd-lines", mostLines);
  }

  function toggle(wanted) {
    const wasOpen = isOpen;
    isOpen = wanted;
    list.hidden = !isOpen;
    if (!wasOpen) mostLines = 0;
    fit();
    if (isOpen !== wasOpen) api.send({ kind: "list", isOpen, free: free() });
    // The hint has its place where the list opens.
    api.root.classList.toggle("pd-lists-problems", isOpen);
    main.setAttribute("aria-expanded", String(isOpen));
    caret.textContent = isOpen ? "\u25be" : "\u25b4";
  }

  function icon(name) {
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("viewBox", "0 0 18 18");
    svg.setAttribute("aria-hidden", "true");
    const path = document.createElementNS(SVG, "path");
    path.setAttribute("d", ICONS[name] ?? ICONS.collision);
    svg.appendChild(path);
    return svg;
  }

  let drawn = "";
  function drawRows() {
    const wanted = JSON.stringify([state.groups, isFolded]);
    if (wanted !== drawn) {
      drawn = wanted;
      const top = rows.scrollTop;
      const focused = document.activeElement?.dataset?.problem;
      const parts = [];
      for (const group of state.groups) {
        if (group.name !== "new" && !group.rows.length) continue;
        const head = make("button", "pd-problem-group", {
          type: "button", "aria-expanded": String(!isFolded[group.name]),
        }, group.title);
        head.addEventListener("click", () => {
          isFolded[group.name] = !isFolded[group.name];
          drawRows();
        });
        parts.push(head);
        if (isFolded[group.name]) continue;
        for (const row of group.rows) {
          const item = make("button", "pd-problem-row", { type: "button", title: row.hint });
          item.dataset.problem = row.id;
          item.dataset.severity = row.severity;
          item.append(
            icon(row.icon), make("span", "pd-clipped", {}, row.text),
            make("span", "pd-problem-time", {}, row.time));
          item.addEventListener("click", () => choose(row.id));
          parts.push(item);
        }
        if (group.more)
          parts.push(make("div", "pd-problem-more", {}, `... and ${group.more} more`));
      }
      rows.replaceChildren(...parts);
      detail.hidden = !rows.querySelector("[data-problem]");
      if (isOpen) fit();
      rows.scrollTop = top;
      if (focused)
        [...rows.querySelectorAll(".pd-problem-row")]
          .find((item) => item.dataset.problem === focused)
          ?.focus({ preventScroll: true });
    }
    for (const item of rows.querySelectorAll(".pd-problem-row"))
      item.setAttribute(
        "aria-current", String(item.dataset.problem === state.active?.id));
  }

  // Escape closes the list, also with the focus on the chip that opened it. With the focus
  // elsewhere the server closes it, unless a mode or a gesture ends first.
  api.listen(api.box, "keydown", (event) => {
    if (event.key !== "Escape" || !isOpen) return;
    toggle(false);
    main.focus();
    event.stopPropagation();
  });
  // Keys walk the rows, and choose them; a page's worth at a time as well.
  const pageful = () => Math.max(1, Math.floor(rows.clientHeight / 28) - 1);
  api.listen(api.box, "keydown", (event) => {
    if (!isOpen || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = {
      ArrowDown: 1, ArrowUp: -1, PageDown: pageful(), PageUp: -pageful(),
      Home: -Infinity, End: Infinity,
    }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    const all = [...rows.querySelectorAll(".pd-problem-row")];
    if (!all.length) return;
    const at = all.findIndex((item) => item === document.activeElement);
    const begin = at < 0
      ? all.findIndex((item) => item.dataset.problem === state.active?.id) : at;
    const next = all[Math.min(Math.max(begin + step, 0), all.length - 1)];
    next.focus();
    next.scrollIntoView({ block: "nearest" });
    choose(next.dataset.problem);
  });

  toggle(false);
  let drawnCures = "";
  let numClosed = 0;
  return (next) => {
    if (next.numClosed > numClosed) toggle(false);
    numClosed = next.numClosed;
    const isCuring = cures.contains(document.activeElement);
    const place = [...rows.querySelectorAll(".pd-problem-row")].findIndex(
      (item) => item.dataset.problem === state.active?.id);
    state = next;
    chip.dataset.tone = next.tone;
    if (text.textContent !== next.text) text.textContent = next.text;
    text.title = next.text;
    cancel.hidden = next.fraction === null;
    use.hidden = !next.action;
    use.textContent = next.action;
    caret.hidden = !cancel.hidden || !use.hidden;
    bar.hidden = next.fraction === null;
    bar.style.width = `${100 * (next.fraction ?? 0)}%`;
    bar.setAttribute("aria-valuenow", String(Math.round(100 * (next.fraction ?? 0))));
    unsaved.hidden = !next.unsaved;
    unsavedText.textContent = next.unsaved;
    unsavedText.title = next.unsaved;
    api.box.classList.toggle("pd-has-unsaved", Boolean(next.unsaved));
    drawRows();
    const active = next.active;
    const wanted = JSON.stringify(active);
    if (wanted !== drawnCures) {
      drawnCures = wanted;
      sentence.textContent = active
        ? [active.message, active.note].filter(Boolean).join(" ")
        : "Choose a row to see it and what helps.";
      cures.replaceChildren();
      for (const label of active?.cures ?? [])
        button(cures, "pd-strong", label, () =>
          api.send({ kind: "cure", value: label }));
      if (active?.ignore)
        button(cures, "pd-quiet", active.ignore, () => api.send({ kind: "ignore" }));
      // Keys go on from the row that was cured, or from the one in its place.
      const all = [...rows.querySelectorAll(".pd-problem-row")];
      if (isCuring && isOpen)
        (all.find((item) => item.dataset.problem === active?.id)
          ?? all[Math.min(Math.max(place, 0), all.length - 1)] ?? main)
          .focus({ preventScroll: true });
    }
  };
});
