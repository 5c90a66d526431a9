"use strict";
// Answers are kept by rank: { "1": { answer: "yes" | "no" | "unsure" | null, note: "" } }.
const list = JSON.parse(document.getElementById("list").textContent);
const key = "colvis answers " + list.fingerprint;
const kinds = ["yes", "no", "unsure"];
const byId = (id) => document.getElementById(id);
const cards = new Map(list.candidates.map((c) => [c.rank, byId("c" + c.rank)]));
const filter = byId("filter");
let said = {};
let undo = [];
let selected = list.candidates.length ? list.candidates[0].rank : null;

const say = (text) => { byId("message").textContent = text; };
const of = (rank) => said[rank] || { answer: null, note: "" };

// What is read may be from anywhere: only what an answer can be is taken.
const clean = (a) => ({
  answer: kinds.includes(a.answer) ? a.answer : null,
  note: typeof a.note === "string" ? a.note.slice(0, 2000) : "",
});

function restore() {
  try {
    const kept = JSON.parse(localStorage.getItem(key) || "{}");
    for (const rank of cards.keys()) {
      if (kept && kept[rank]) said[rank] = clean(kept[rank]);
    }
  } catch (e) {
    say("This browser keeps no answers of this page: save them before you close it.");
  }
}

function keep() {
  try {
    localStorage.setItem(key, JSON.stringify(said));
  } catch (e) {
    say("This browser keeps no answers of this page: save them before you close it.");
  }
}

const matches = (rank) => filter.value === "all" || (of(rank).answer || "open") === filter.value;
const visible = () => [...cards.keys()].filter((rank) => !cards.get(rank).hidden);

function show() {
  const counts = { yes: 0, no: 0, unsure: 0, open: 0 };
  for (const [rank, card] of cards) {
    const { answer, note } = of(rank);
    counts[answer || "open"] += 1;
    card.dataset.said = answer || "";
    card.querySelector(".said").textContent = answer || "";
    card.hidden = !matches(rank);
    card.classList.toggle("selected", rank === selected);
    if (rank === selected) card.setAttribute("aria-current", "true");
    else card.removeAttribute("aria-current");
    for (const button of card.querySelectorAll("[data-answer]")) {
      button.setAttribute("aria-pressed", String(button.dataset.answer === answer));
    }
    const field = card.querySelector("textarea");
    if (field.value !== note) field.value = note;
  }
  byId("counts").textContent = ["yes", "no", "unsure", "open"].map((k) => counts[k] + " " + k).join(", ");
}

function select(rank, moves) {
  selected = rank;
  show();
  const card = cards.get(rank);
  if (!card || !moves) return;
  card.focus({ preventScroll: true });
  card.scrollIntoView({ block: "start" });
}

// The visible card after (1) or before (-1) the selected one.
function step(by) {
  const ranks = visible();
  const onwards = by > 0 ? ranks.find((r) => r > selected) : ranks.filter((r) => r < selected).pop();
  if (onwards !== undefined) select(onwards, true);
  else if (ranks.includes(selected)) select(selected, true);
  else if (ranks.length) select(by > 0 ? ranks[ranks.length - 1] : ranks[0], true);
}

// A card that the filter hides is left for the next one.
function settle() {
  show();
  const ranks = visible();
  if (ranks.includes(selected) || !ranks.length) return;
  const next = ranks.find((r) => r > selected);
  select(next !== undefined ? next : ranks[ranks.length - 1], true);
}

function answer(rank, value) {
  // A hidden card is not answered by a key.
  if (rank === null || cards.get(rank).hidden || of(rank).answer === value) return;
  undo.push({ rank, answer: of(rank).answer });
  said[rank] = { ...of(rank), answer: value };
  keep();
  settle();
}

function back() {
  const last = undo.pop();
  if (!last) return;
  said[last.rank] = { ...of(last.rank), answer: last.answer };
  keep();
  if (!matches(last.rank)) filter.value = "all";
  select(last.rank, true);
}

function save() {
  const answers = list.candidates
    .map((c) => ({ rank: c.rank, position: c.position, ...of(c.rank) }))
    .filter((a) => a.answer !== null || a.note !== "");
  const text = JSON.stringify({ colvis: "answers", scan: list.scan, answers }, null, 2) + "\n";
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
  link.download = "answers.json";
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// Answers belong to places: those of another list of the same scan are found by position, within 1 mm.
function take(text) {
  const file = JSON.parse(text);
  if (!file || file.colvis !== "answers" || !Array.isArray(file.answers)) throw new Error("it has no answers");
  const near = (p) => (c) => Array.isArray(p) && p.length === 3 && Math.hypot(...c.position.map((x, n) => x - p[n])) <= 1;
  let missed = 0;
  for (const a of file.answers) {
    const candidate = a && list.candidates.find(near(a.position));
    if (candidate) said[candidate.rank] = clean(a);
    else missed += 1;
  }
  undo = [];
  keep();
  settle();
  const notes = [];
  if (file.scan !== list.scan) notes.push("These answers are of another scan, " + file.scan + ".");
  if (missed) notes.push(missed + " of " + file.answers.length + " answers are of no candidate on this page.");
  say(notes.join(" "));
}

byId("load").addEventListener("change", (event) => {
  const input = event.target;
  const file = input.files[0];
  if (!file) return;
  file.text().then(take).catch((e) => say(file.name + " cannot be loaded: " + e.message + "."));
  // The same file can be loaded again.
  input.value = "";
});
byId("save").addEventListener("click", save);
filter.addEventListener("change", settle);
for (const [rank, card] of cards) {
  card.addEventListener("focusin", () => { if (selected !== rank) select(rank, false); });
  card.addEventListener("click", () => { if (selected !== rank) select(rank, false); });
  for (const button of card.querySelectorAll("[data-answer]")) {
    button.addEventListener("click", () => answer(rank, button.dataset.answer));
  }
  card.querySelector("textarea").addEventListener("input", (event) => {
    said[rank] = { ...of(rank), note: event.target.value };
    keep();
  });
}

const keys = {
  j: () => step(1),
  ArrowDown: () => step(1),
  ArrowRight: () => step(1),
  k: () => step(-1),
  ArrowUp: () => step(-1),
  ArrowLeft: () => step(-1),
  y: () => answer(selected, "yes"),
  n: () => answer(selected, "no"),
  u: () => answer(selected, "unsure"),
  z: back,
  Backspace: back,
  e: () => { if (selected !== null) cards.get(selected).querySelector("textarea").focus(); },
  f: () => { filter.selectedIndex = (filter.selectedIndex + 1) % filter.options.length; settle(); },
  s: save,
};
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.isComposing) return;
  const tag = event.target.tagName;
  if (tag === "TEXTAREA") {
    if (event.key === "Escape") select(selected, true);
    return;
  }
  if (tag === "SELECT" || tag === "INPUT") return;
  const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (!Object.hasOwn(keys, name)) return;
  event.preventDefault();
  keys[name]();
});

restore();
show();
