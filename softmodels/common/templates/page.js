// The controls of a page: the unit of pressures in texts, tables and charts; charts as SVG; printing. No network.
"use strict";
(function () {
  for (const part of document.querySelectorAll(".program")) part.hidden = false;
  document.getElementById("print").addEventListener("click", () => window.print());

  // -- units: a text has a number or several of them before "cm", perhaps with the same in kPa or Pa behind it --------
  const select = document.getElementById("units"), factors = JSON.parse(select.dataset.factors), own = select.value;
  const root = document.documentElement;
  const number = "-?\\d[\\d.]*(?:e[+-]?\\d+)?";
  const pattern = new RegExp(`(?<![\\w.=]|= )((?:${number}(?:, | and | to | or ))*${number}) cm(?:, [\\d.]+ g\\/ml)?(?: \\(-?[\\d.e+-]+ k?Pa\\))?(?![\\w^]| is )`, "g");
  const digits = (pascal, count) => String(+(pascal / factors[select.value]).toPrecision(count));
  const turned = (text) => text.replace(pattern, (all, list) =>
    `${list.replace(new RegExp(number, "g"), (one) => digits(one * factors.cm, 4))} ${select.value}`);
  const texts = new Map();
  const gather = (top) => {
    const walker = document.createTreeWalker(top, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
      if (node.parentElement.closest("script,style,pre,code,svg,select,[data-pa],[data-pu]")) continue;
      if (node.data.search(pattern) >= 0) texts.set(node, node.data);
    }
  };
  gather(document.body);
  const cells = [...document.querySelectorAll("[data-pa],[data-pu]")].map((cell) => [cell, cell.textContent]);
  const switched = texts.size + cells.length + document.querySelectorAll(".pu").length;
  select.parentElement.hidden = !switched;
  function show() {
    const unit = select.value;
    root.dataset.unit = unit;
    for (const [node, text] of texts) node.data = unit === "cm" ? text : turned(text);
    for (const [cell, text] of cells) {
      if (unit === own) cell.textContent = text;
      else if (cell.dataset.pa !== undefined) cell.textContent = digits(+cell.dataset.pa, 6);
      else cell.textContent = text.replace(`(${cell.dataset.pu})`, `(${unit})`);
    }
  }
  select.addEventListener("input", show);
  const label = document.getElementById("viewer-label");
  if (label) new MutationObserver(() => { for (const node of texts.keys()) if (!node.isConnected) texts.delete(node); gather(label); show(); })
    .observe(label, { childList: true });

  // -- charts: what is shown of one, as a file -----------------------------------------------------------------------
  for (const figure of document.querySelectorAll("[data-name]")) {
    const button = document.createElement("button");
    button.textContent = "SVG";
    button.setAttribute("aria-label", `download ${figure.dataset.name}`);
    button.addEventListener("click", () => {
      const copy = figure.querySelector("svg").cloneNode(true);
      for (const other of copy.querySelectorAll(".pu")) if (!other.classList.contains(`pu-${select.value}`)) other.remove();
      const text = new XMLSerializer().serializeToString(copy).replaceAll("currentColor", "#000000").replaceAll(/var\(--\w+, ?(#\w+)\)/g, "$1");
      const link = document.createElement("a");
      link.href = URL.createObjectURL(new Blob([text], { type: "image/svg+xml" }));
      link.download = figure.dataset.name;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
    figure.append(button);
  }
})();
