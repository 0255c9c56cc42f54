"use strict";
// Chooses the theme before anything is drawn, so that a dark page does not flash.

const root = document.documentElement;
const system = window.matchMedia("(prefers-color-scheme: dark)");

function stored(value) {
  // a browser may refuse storage to files
  try { if (value) localStorage.setItem("rescore-theme", value); return localStorage.getItem("rescore-theme"); } catch { return value ?? null; }
}
let theme = stored() ?? "auto";
function applyTheme() {
  root.dataset.theme = theme === "auto" ? (system.matches ? "dark" : "light") : theme;
  for (const b of document.querySelectorAll("button[data-set-theme]")) b.setAttribute("aria-pressed", b.dataset.setTheme === theme);
}
applyTheme();
