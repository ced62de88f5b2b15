// The list of pages shows its groups, and the pages of the group that the reader is in; the first group on other pages. On a phone
// long tables and the entries of a reference are folded, on long pages the programs, and on those that are still long the sections:
// what follows them would be thousands of pixels away. A link into one opens it.
document.addEventListener("DOMContentLoaded", () => {
  const groups = [...document.querySelectorAll(".sidebar-tree > p.caption")];
  const current = groups.find((caption) => caption.nextElementSibling.querySelector(".current"));
  for (const caption of groups) {
    const group = document.createElement("details"), name = document.createElement("summary");
    group.open = caption === (current || groups[0]);
    name.className = caption.className;
    name.append(...caption.childNodes);
    caption.before(group);
    group.append(name, caption.nextElementSibling);
    caption.remove();
  }
  const mostRows = 8, mostLines = 12, mostEntries = 40, mostHeight = 10000;  // pixels, without pictures, which come later
  const fold = (text, ...content) => {
    const details = document.createElement("details"), summary = document.createElement("summary");
    details.className = "fold";
    content[0].before(details);
    summary.append(text);
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
  const isLong = () => document.documentElement.scrollHeight > mostHeight;
  if (isLong())
    for (const program of document.querySelectorAll("article div[class^=highlight-]")) {
      const lines = program.textContent.trimEnd().split("\n").length;
      if (lines > mostLines && !program.closest("details.fold")) fold(`Program of ${lines} lines`, program);
    }
  if (isLong())
    for (const section of document.querySelectorAll("article > section > section, article > div > section > section")) {
      const [head, first, ...rest] = [...section.children].filter((child) => child.tagName !== "SPAN");
      if (first) fold(head, first, ...rest);
    }
  const open = () => {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    let folded = target.querySelector(":scope > details.fold") || target.closest("details.fold");
    if (!folded) return;
    for (; folded; folded = folded.parentElement.closest("details.fold")) folded.open = true;
    target.scrollIntoView({ behavior: "instant" });
  };
  addEventListener("hashchange", open);
  addEventListener("load", open);  // the pictures above the place have their heights now
});
