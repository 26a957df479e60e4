// The list of agents: search, sort, filters, selection. Only rows in sight have elements.
//
// A row of the state is [id, kind, speed, distance, marks, isMoving]; events name agents
// by their place in it, with the number of the list that they belong to.
(() => {
  const ROW_PX = 24;
  const MARKS = [
    [1, "F", "focal agent", "pd-focal"],
    [2, "E", "ego", "pd-ego"],
    [64, "!", "has a problem", "pd-bad"],
    [256, "", "locked", "pd-locked"],
    [128, "~", "trajectory no longer fits", "pd-warn"],
    [4, "N", "new", "pd-new"],
    [8, "e", "edited", "pd-edited"],
    [16, "L", "comes later than t = 0", "pd-later"],
    [32, "G", "is gone by t = 0", "pd-later"],
  ];
  const NEW = 4;
  const MAIN = 3; // focal agent and ego are found by these words, too
  const SHAPES = { vehicle: "box", bus: "long", pedestrian: "dot", cyclist: "peak",
    motorcyclist: "peak" };

  let number = 0;
  let rows = [];
  let kinds = [];
  let shown = [];
  let selected = new Set();
  let underPointer = null; // id of the agent that the pointer rests on in the picture
  let redraw = () => {};
  let reveal = () => {};

  pdOverlay.define("agents", (api) => {
    const { make } = api;
    const drawer = make("div", "pd-solid pd-agents", {
      role: "region", "aria-label": "Agent list",
    });
    drawer.hidden = true;
    const search = make("input", "pd-search", {
      type: "search", placeholder: "Search by id, kind, focal, ego", "aria-label": "Search agents",
      spellcheck: "false", autocomplete: "off",
    });
    const close = make("button", "pd-close", {
      type: "button", "aria-label": "Close the agent list", title: "Close (Ctrl+F)",
    }, "\u00d7");
    const head = make("div", "pd-agents-head");
    head.append(search, close);
    const filters = make("div", "pd-agents-filters");
    const filter = { moving: false, new: false, kind: -1 };
    for (const [key, text, title] of [
      ["moving", "Moving", "Only agents that move at t = 0"],
      ["new", "New", "Only agents that the recording does not have"],
    ]) {
      const button = make("button", "", { type: "button", "aria-pressed": "false", title },
        text);
      button.addEventListener("click", () => {
        filter[key] = !filter[key];
        button.setAttribute("aria-pressed", String(filter[key]));
        arrange();
      });
      filters.append(button);
    }
    const kindBox = make("select", "", { "aria-label": "Kind" });
    kindBox.addEventListener("change", () => {
      filter.kind = Number(kindBox.value);
      arrange();
    });
    filters.append(kindBox);

    const sort = { column: -1, isDown: false };
    const columns = make("div", "pd-agents-columns");
    const headings = [
      ["Agent", "Sort by id", 0], ["m/s", "Sort by speed at t = 0", 2],
      ["m", "Sort by distance to the focal agent", 3], ["Marks", "Sort by marks", 4],
    ].map(([text, title, column]) => {
      const button = make("button", "", { type: "button", title, "aria-label": title }, text);
      button.addEventListener("click", () => {
        // The third click takes the order of the recording.
        if (sort.column !== column) Object.assign(sort, { column, isDown: false });
        else if (!sort.isDown) sort.isDown = true;
        else Object.assign(sort, { column: -1, isDown: false });
        for (const [other, element] of headings)
          element.textContent = element.dataset.text +
            (other === sort.column ? (sort.isDown ? " \u25be" : " \u25b4") : "");
        arrange();
      });
      button.dataset.text = text;
      columns.append(button);
      return [column, button];
    });

    const list = make("div", "pd-agents-list", {
      role: "listbox", "aria-label": "Agents", "aria-multiselectable": "true", tabindex: "0",
    });
    const space = make("div", "pd-agents-space");
    list.append(space);
    const count = make("div", "pd-agents-count", { role: "status" });
    const foot = make("div", "pd-agents-foot");
    for (const [text, title, wanted] of [
      ["All", "Select all agents of the list", () => [...shown]],
      ["None", "Select none", () => []],
      ["Invert", "Select the agents of the list that are not selected",
        () => shown.filter((row) => !selected.has(row))],
      ["Same kind", "Add all agents of the kinds that are selected", () => {
        const wantedKinds = new Set([...selected].map((row) => rows[row][1]));
        return rows.map((_, row) => row).filter((row) => wantedKinds.has(rows[row][1]));
      }],
    ]) {
      const button = make("button", "", { type: "button", title }, text);
      button.addEventListener("click", () => choose(wanted()));
      foot.append(button);
    }
    const lock = make("button", "", {
      type: "button", title: "Lock or unlock the selected agents (K)",
    }, "Lock");
    lock.addEventListener("click", () => api.send({ kind: "lock", number }));
    foot.append(lock);
    drawer.append(head, filters, columns, list, count, foot);
    api.box.append(drawer);

    function choose(wanted) {
      api.send({ kind: "select", number, rows: wanted });
    }

    let anchor = null;
    let cursor = null;
    function pick(row, event) {
      const place = shown.indexOf(row);
      const from = anchor === null ? -1 : shown.indexOf(anchor);
      if (event.shiftKey && from >= 0) {
        const range = shown.slice(Math.min(from, place), Math.max(from, place) + 1);
        choose(event.ctrlKey || event.metaKey ? [...new Set([...selected, ...range])] : range);
      } else if (event.ctrlKey || event.metaKey) {
        anchor = row;
        choose(selected.has(row) ? [...selected].filter((one) => one !== row)
          : [...selected, row]);
      } else {
        anchor = row;
        choose([row]);
      }
      cursor = row;
    }

    let pointed = null;
    function point(row) {
      if (row === pointed) return;
      pointed = row;
      api.send({ kind: "point", number, row });
    }

    const pool = new Map();
    function rowElement(row) {
      const [id, kind, speed, distance, marks] = rows[row];
      const element = make("div", "pd-agents-row", { role: "option" });
      const glyph = make("span", `pd-glyph pd-${SHAPES[kinds[kind][0]] ?? "thing"}`, {
        title: kinds[kind][0],
      });
      const color = marks & 1 ? kinds.focal : marks & 2 ? kinds.ego : kinds[kind][1];
      glyph.style.background = color;
      const name = make("span", "pd-name", { title: `${kinds[kind][0]} ${id}` }, id);
      const numbers = [speed, distance].map((value) =>
        make("span", "pd-number", {}, value === null ? "\u2013" : value.toFixed(1)));
      const badges = make("span", "pd-badges");
      const words = [];
      for (const [bit, letter, word, style] of MARKS)
        if (marks & bit) {
          badges.append(make("span", `pd-badge ${style}`, { title: word }, letter));
          words.push(word);
        }
      element.setAttribute("aria-label", [`${kinds[kind][0]} ${id}`, ...words].join(", "));
      element.append(glyph, name, ...numbers, badges);
      element.addEventListener("click", (event) => pick(row, event));
      element.addEventListener("pointerenter", () => point(row));
      return element;
    }

    redraw = () => {
      if (drawer.hidden) return;
      const first = Math.max(0, Math.floor(list.scrollTop / ROW_PX) - 4);
      const last = Math.min(shown.length,
        Math.ceil((list.scrollTop + list.clientHeight) / ROW_PX) + 4);
      const wanted = new Set(shown.slice(first, last));
      for (const [row, element] of pool)
        if (!wanted.has(row)) {
          element.remove();
          pool.delete(row);
        }
      for (let place = first; place < last; place += 1) {
        const row = shown[place];
        let element = pool.get(row);
        if (!element) {
          element = rowElement(row);
          pool.set(row, element);
          space.append(element);
        }
        element.style.top = `${place * ROW_PX}px`;
        element.setAttribute("aria-selected", String(selected.has(row)));
        element.classList.toggle("pd-lit", rows[row][0] === underPointer);
        element.setAttribute("aria-posinset", String(place + 1));
        element.setAttribute("aria-setsize", String(shown.length));
      }
      count.textContent = `${shown.length} of ${rows.length} listed, ` +
        `${selected.size} selected`;
    };

    function arrange() {
      const words = search.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
      shown = [];
      rows.forEach(([id, kind, , , marks, isMoving], row) => {
        const main = MARKS.filter(([bit]) => marks & bit & MAIN).map(([, , word]) => word);
        const text = [kinds[kind][0], id, ...main].join(" ").toLowerCase();
        if (words.every((word) => text.includes(word)) && (!filter.moving || isMoving) &&
            (!filter.new || marks & NEW) && (filter.kind < 0 || filter.kind === kind))
          shown.push(row);
      });
      if (sort.column >= 0) {
        const sign = sort.isDown ? -1 : 1;
        const compare = sort.column === 0
          ? (a, b) => a[0].localeCompare(b[0], undefined, { numeric: true })
          : sort.column === 4 ? (a, b) => b[4] - a[4]
            : (a, b) => (a[sort.column] ?? Infinity) - (b[sort.column] ?? Infinity);
        shown.sort((a, b) => sign * compare(rows[a], rows[b]) || a - b);
      }
      for (const element of pool.values()) element.remove();
      pool.clear();
      space.style.height = `${shown.length * ROW_PX}px`;
      redraw();
    }

    // A selected agent's row comes into sight, unless one is in sight already.
    reveal = () => {
      bringIntoSight([...selected]);
    };
    function bringIntoSight(wanted) {
      const places = wanted.map((row) => shown.indexOf(row)).filter((p) => p >= 0);
      const top = list.scrollTop;
      const bottom = top + list.clientHeight - ROW_PX;
      if (!places.length || places.some((p) => p * ROW_PX >= top && p * ROW_PX <= bottom))
        return;
      list.scrollTop = places[0] * ROW_PX - list.clientHeight / 2;
    }
    api.listen(window, "pd-agent-under-pointer", (event) => {
      underPointer = event.detail;
      if (drawer.hidden) return;
      const row = rows.findIndex(([id]) => id === underPointer);
      if (row >= 0) bringIntoSight([row]);
      redraw();
    });

    list.addEventListener("scroll", redraw);
    list.addEventListener("pointerleave", () => point(null));
    list.addEventListener("keydown", (event) => {
      const pageful = Math.max(1, Math.floor(list.clientHeight / ROW_PX) - 1);
      const by = {
        ArrowDown: 1, ArrowUp: -1, PageDown: pageful, PageUp: -pageful,
        Home: -Infinity, End: Infinity,
      }[event.key];
      if (!by || !shown.length) return;
      event.preventDefault();
      event.stopPropagation();
      const place = cursor === null ? -1 : shown.indexOf(cursor);
      const next = shown[Math.min(Math.max(place + by, 0), shown.length - 1)];
      pick(next, event);
      const y = shown.indexOf(next) * ROW_PX;
      if (y < list.scrollTop) list.scrollTop = y;
      if (y + ROW_PX > list.scrollTop + list.clientHeight)
        list.scrollTop = y + ROW_PX - list.clientHeight;
    });
    search.addEventListener("input", arrange);
    search.addEventListener("keydown", (event) => {
      event.stopPropagation();
      if (event.key === "ArrowDown") list.focus();
      if (event.key === "Enter" && shown.length) choose([...shown]);
      if (event.key === "Escape") {
        if (search.value) {
          search.value = "";
          arrange();
        } else api.send({ kind: "close" });
      }
    });
    close.addEventListener("click", () => api.send({ kind: "close" }));
    // The browser's own search would find nothing here.
    api.listen(document, "keydown", (event) => {
      if ((event.ctrlKey || event.metaKey) && !event.shiftKey && !event.altKey &&
          event.key.toLowerCase() === "f") {
        event.preventDefault();
        if (/^(INPUT|TEXTAREA)$/.test(event.target?.tagName ?? ""))
          api.send({ kind: event.target === search ? "close" : "open" });
      }
    }, true);

    return (state) => {
      const wasHidden = drawer.hidden;
      drawer.hidden = !state.isOpen;
      if (!state.isOpen) {
        if (!wasHidden && drawer.contains(document.activeElement))
          document.activeElement.blur();
        return;
      }
      number = state.number;
      rows = state.rows;
      kinds = Object.assign(state.kinds, { focal: state.focal, ego: state.ego });
      kindBox.replaceChildren(make("option", "", { value: "-1" }, "All kinds"),
        ...kinds.map(([name], kind) => make("option", "", { value: String(kind) }, name)));
      if (filter.kind >= kinds.length) filter.kind = -1;
      kindBox.value = String(filter.kind);
      selected = new Set([...selected].filter((row) => row < rows.length));
      arrange();
      if (wasHidden) {
        search.focus();
        reveal();
      }
    };
  });

  pdOverlay.define("agent-selection", () => (state) => {
    selected = new Set(state.rows);
    redraw();
    reveal();
  });
})();
