"use strict";
// The page works without this: it shows some of the cases on it.
const tools = document.querySelector(".tools");
if (tools) {
  const [text, state, count] = ["text", "state", "count"].map((id) => document.getElementById(id));
  const cases = [...document.querySelectorAll(".cases.all > .case")];
  const words = cases.map((c) => c.textContent.toLowerCase());
  const show = () => {
    const wanted = text.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0;
    cases.forEach((c, n) => {
      const isState = state.value === "" || c.classList.contains(state.value);
      c.hidden = !(isState && wanted.every((w) => words[n].includes(w)));
      shown += c.hidden ? 0 : 1;
    });
    count.textContent = shown === cases.length ? "" : `${shown} of ${cases.length} shown`;
  };
  text.addEventListener("input", show);
  state.addEventListener("change", show);
  tools.hidden = false;
  show();
}
