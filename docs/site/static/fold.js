// On a phone long tables are folded, and the entries of a reference: what follows them would be thousands of pixels away. A
// link into one opens it.
document.addEventListener("DOMContentLoaded", () => {
  const mostRows = 8, mostEntries = 40;
  const fold = (text, ...content) => {
    const details = document.createElement("details"), summary = document.createElement("summary");
    details.className = "fold";
    summary.textContent = text;
    content[0].before(details);
    details.append(summary, ...content);
  };
  if (!matchMedia("(max-width: 40em)").matches) return;
  for (const wrapper of document.querySelectorAll("div.table-wrapper")) {
    const rows = wrapper.querySelectorAll("tbody > tr").length;
    if (rows <= mostRows) continue;
    const heads = [...wrapper.querySelectorAll("thead th")].map((head) => head.textContent.trim()).filter(Boolean);
    fold(`Table of ${rows} rows: ${heads.slice(0, 4).join(", ")}${heads.length > 4 ? ", …" : ""}`, wrapper);
  }
  const entries = document.querySelectorAll("section section section");
  if (entries.length > mostEntries)
    for (const entry of entries) {
      const [, first, ...rest] = entry.children;
      const about = entry.querySelector(":scope > p");
      if (first) fold(about ? about.textContent.split(/[.:;]\s/)[0] : "Signature", first, ...rest);
    }
  const open = () => {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    const folds = target ? [target.closest("details.fold"), target.querySelector(":scope > details.fold")].filter(Boolean) : [];
    for (const each of folds) each.open = true;
    if (folds.length) target.scrollIntoView();
  };
  addEventListener("hashchange", open);
  open();
});
