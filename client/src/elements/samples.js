// The strip of samples, above the timeline: a card for each sample of the last run.
//
// Pictures come apart from the rest, since they are large and change with a run only.
(() => {
  let pictures = [];
  let redraw = () => {};

  pdOverlay.define("samples", (api) => {
    const { make } = api;
    const strip = make("section", "pd-solid pd-samples", { "aria-label": "Samples" });
    const head = make("div", "pd-samples-head");
    const title = make("strong", "pd-samples-title");
    const chooser = (label, kind) => {
      const select = make("select", "", { "aria-label": label, title: label });
      select.addEventListener("change", () => {
        const value = kind === "pick" ? Number(select.value) : select.value;
        api.send({ kind, value });
      });
      return select;
    };
    const ranking = chooser("Order of the samples", "rank");
    const pick = chooser("Samples shown", "pick");
    const hint = make("span", "pd-samples-hint", {},
      "Point to preview, click to use, C compares");
    const close = make("button", "pd-close", {
      type: "button", "aria-label": "Close the samples", title: "Close (Esc)",
    }, "\u00d7");
    close.addEventListener("click", () => api.send({ kind: "close" }));
    head.append(title, ranking, pick, hint, close);
    const list = make("div", "pd-samples-list", {
      role: "listbox", "aria-label": "Samples of the last run",
      "aria-orientation": "horizontal",
    });
    strip.append(head, list);
    strip.hidden = true;
    api.box.append(strip);

    let state = { cards: [] };
    let cursor = null;
    let pointed = null;
    let shownInUse = null; // the card in use that was scrolled into sight

    function point(index) {
      if (pointed === index) return;
      pointed = index;
      api.send(index === null ? { kind: "leave" } : { kind: "point", value: index });
    }

    const cards = () => [...list.querySelectorAll(".pd-sample")];

    function moveTo(place) {
      const all = cards();
      if (!all.length) return;
      const card = all[Math.min(Math.max(place, 0), all.length - 1)];
      cursor = Number(card.dataset.index);
      for (const one of all) one.tabIndex = one === card ? 0 : -1;
      card.focus({ preventScroll: true });
      card.scrollIntoView({ block: "nearest", inline: "nearest" });
      point(cursor);
    }

    strip.addEventListener("pointerleave", () => point(null));
    strip.addEventListener("keydown", (event) => {
      const place = cards().findIndex((one) => Number(one.dataset.index) === cursor);
      const target = {
        ArrowLeft: place - 1, ArrowRight: place + 1, Home: 0, End: Infinity,
      }[event.key];
      if (event.key === "Escape") api.send({ kind: "close" });
      else if (event.target.tagName === "SELECT") return;
      else if (target !== undefined) moveTo(target);
      else if (event.key === "Enter" && event.target.classList.contains("pd-sample"))
        api.send({ kind: "adopt", value: Number(event.target.dataset.index) });
      else return;
      event.preventDefault();
      event.stopPropagation();
    });
    strip.addEventListener("focusout", (event) => {
      if (!strip.contains(event.relatedTarget) && !strip.matches(":hover")) point(null);
    });

    function fill(select, options, value) {
      const text = JSON.stringify(options);
      if (select.dataset.options !== text) {
        select.dataset.options = text;
        select.replaceChildren(...options.map((one) =>
          make("option", "", { value: String(one.value) }, one.text)));
      }
      select.value = String(value);
    }

    function cardOf({ index, rank, isAdopted, lines, hint }) {
      const box = make("div", "pd-sample-box");
      const card = make("div", "pd-sample", {
        role: "option", tabindex: "-1", "aria-selected": String(isAdopted),
        "aria-label": `Sample ${index + 1}`, title: hint,
      });
      card.dataset.index = String(index);
      const picture = make("img", "", { alt: "", draggable: "false" });
      if (pictures[index]) picture.src = pictures[index];
      const name = make("div", "pd-sample-name");
      name.append(
        make("span", "", {}, `Sample ${index + 1}`),
        make("span", "pd-sample-rank", {},
          isAdopted ? `in use \u00b7 ${rank}.` : `${rank}.`));
      card.append(picture, name, ...lines.map(({ text, tone }) =>
        make("div", tone ? `pd-sample-line pd-${tone}` : "pd-sample-line", {}, text)));
      card.addEventListener("pointerenter", () => point(index));
      card.addEventListener("click", () => {
        cursor = index;
        api.send({ kind: "adopt", value: index });
      });
      const keep = make("button", "pd-sample-keep", {
        type: "button", tabindex: "-1",
        "aria-label": `Use sample ${index + 1} and put it into the basket`,
        title: "Use it and put it into the basket",
      }, "\u2606");
      keep.addEventListener("click", () => api.send({ kind: "keep", value: index }));
      box.append(card, keep);
      if (!isAdopted) {
        const pair = make("button", "pd-sample-keep pd-sample-pair", {
          type: "button", tabindex: "-1",
          "aria-label": `Compare sample ${index + 1} with the one in use`,
          title: "Side by side with the sample in use",
        }, "\u25eb");
        pair.addEventListener("click", () => api.send({ kind: "pair", value: index }));
        box.append(pair);
      }
      return box;
    }

    redraw = () => {
      strip.hidden = !state.isOpen;
      api.root.classList.toggle("pd-shows-samples", Boolean(state.isOpen));
      if (!state.isOpen) {
        pointed = cursor = shownInUse = null;
        return;
      }
      const hadFocus = list.contains(document.activeElement);
      title.textContent = `${pictures.length} samples`;
      fill(ranking, state.rankings, state.ranking);
      fill(pick, state.picks, state.pick);
      list.replaceChildren(...state.cards.map(cardOf));
      const all = cards();
      const current = all.find((one) => Number(one.dataset.index) === cursor) ??
        all.find((one) => one.getAttribute("aria-selected") === "true") ?? all[0];
      if (!current) return;
      current.tabIndex = 0;
      const inUse = state.cards.find((one) => one.isAdopted)?.index ?? null;
      if (inUse !== shownInUse) {
        shownInUse = inUse;
        all.find((one) => Number(one.dataset.index) === inUse)?.scrollIntoView(
          { block: "nearest", inline: "nearest" });
      }
      if (state.takesFocus || hadFocus) moveTo(all.indexOf(current));
    };

    return (next) => {
      state = next;
      redraw();
    };
  });

  pdOverlay.define("sample-pictures", () => (state) => {
    pictures = state.pictures;
    redraw();
  });
})();
