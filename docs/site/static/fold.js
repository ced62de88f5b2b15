// On a phone long tables are folded: what follows them would be thousands of pixels away. A link into a table opens it.
document.addEventListener("DOMContentLoaded", () => {
  const mostRows = 8;
  if (!matchMedia("(max-width: 40em)").matches) return;
  for (const wrapper of document.querySelectorAll("div.table-wrapper")) {
    const rows = wrapper.querySelectorAll("tbody > tr").length;
    if (rows <= mostRows) continue;
    const details = document.createElement("details"), summary = document.createElement("summary");
    const heads = [...wrapper.querySelectorAll("thead th")].map((head) => head.textContent.trim()).filter(Boolean);
    details.className = "fold";
    summary.textContent = `Table of ${rows} rows: ${heads.slice(0, 4).join(", ")}${heads.length > 4 ? ", …" : ""}`;
    wrapper.replaceWith(details);
    details.append(summary, wrapper);
  }
  const open = () => {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    const fold = target && target.closest("details.fold");
    if (fold) { fold.open = true; target.scrollIntoView(); }
  };
  addEventListener("hashchange", open);
  open();
});
