// Holding O compares with the original: the page tells when the key goes down and up.
import { hasModifier, isTyping, make } from "../dom.ts";
import { define, listen } from "../frame.ts";

define("compare", (api) => {
  const plate = make("div", "pd-solid pd-compare", { role: "status" });
  plate.hidden = true;
  api.box.append(plate);
  let isHeld = false;

  function hold(isDown: boolean) {
    if (isHeld === isDown) return;
    isHeld = isDown;
    api.send({ kind: isDown ? "hold" : "release" });
  }

  listen(document, "keydown", (event) => {
    if (event.code !== "KeyO" || event.repeat || isTyping(event)) return;
    if (!hasModifier(event) && !event.shiftKey) hold(true);
  });
  listen(document, "keyup", (event) => {
    if (event.code === "KeyO") hold(false);
  });
  listen(window, "blur", () => hold(false));

  return ({ text }) => {
    plate.hidden = !text;
    plate.textContent = text;
  };
});
