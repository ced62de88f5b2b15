// Sphinx writes \( \) and \[ \] for KaTeX to find.
document.addEventListener("DOMContentLoaded", () => {
  for (const element of document.querySelectorAll(".math")) renderMathInElement(element);
});
