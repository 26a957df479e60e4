// One line at the top centre: the mode that the editor is in, and a button that ends it.
pdOverlay.define("banner", (api) => {
  const bar = api.make("div", "pd-solid pd-banner-bar", {
    role: "status", "aria-live": "polite", "aria-label": "Mode",
  });
  const words = api.make("span", "pd-banner-text");
  const button = api.make("button", "", { type: "button" });
  bar.append(words, button);
  api.box.append(bar);
  bar.hidden = true;
  let owner = null;
  button.addEventListener("click", () => api.send({ kind: "press", owner }));
  return (state) => {
    owner = state.owner;
    bar.hidden = owner === null;
    words.textContent = state.text;
    button.hidden = state.button === null;
    button.textContent = state.button ?? "";
  };
});
