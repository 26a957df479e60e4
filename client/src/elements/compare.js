// Holding O compares with the original: the page tells when the key goes down and up.
pdOverlay.define("compare", (api) => {
  const plate = api.make("div", "pd-solid pd-compare", { role: "status" });
  plate.hidden = true;
  api.box.append(plate);
  let isHeld = false;

  function hold(isDown) {
    if (isHeld === isDown) return;
    isHeld = isDown;
    api.send({ kind: isDown ? "hold" : "release" });
  }

  const isTyping = (target) =>
    target?.isContentEditable || /^(INPUT|TEXTAREA|SELECT)$/.test(target?.tagName ?? "");
  api.listen(document, "keydown", (event) => {
    if (event.code !== "KeyO" || event.repeat || isTyping(event.target)) return;
    if (event.ctrlKey || event.metaKey || event.altKey || event.shiftKey) return;
    hold(true);
  });
  api.listen(document, "keyup", (event) => {
    if (event.code === "KeyO") hold(false);
  });
  api.listen(window, "blur", () => hold(false));

  return ({ text }) => {
    plate.hidden = !text;
    plate.textContent = text;
  };
});
