// What the figures of a report answer. Hover: the nearest point and its series. Click: the figure large, to zoom and to
// move. Of figures that belong together a list shows one. Without this script all are shown.
"use strict";
(() => {
  const NEAR_PX = 40, SNAP_PX = 6, STEP = 1.4, MOST = 40, NARROW_PX = 640;
  const make = (tag, name, text = "") => Object.assign(document.createElement(tag), { className: name, textContent: text });

  // The points of a figure, from the drawing itself; the figure stays a picture, and nothing in its file can act.
  const drawings = new Map();
  const drawingOf = image => {
    if (!drawings.has(image.src)) {
      let drawing = null;
      try { drawing = read(image.src); } catch { /* a picture of another program tells nothing */ }
      drawings.set(image.src, drawing);
    }
    return drawings.get(image.src);
  };
  const read = source => {
    const bytes = Uint8Array.from(atob(source.split(",")[1]), letter => letter.charCodeAt(0));
    const svg = new DOMParser().parseFromString(new TextDecoder().decode(bytes), "image/svg+xml");
    const [, , width, height] = svg.documentElement.getAttribute("viewBox").split(" ").map(Number);
    const panels = JSON.parse(svg.getElementById("readings").textContent);
    for (const panel of panels) for (const series of panel.series)
      series.lines = series.at ? series.at.map(at => [onPaper(panel, at)]) : linesOf(svg.getElementById(series.id));
    return { width, height, panels };
  };
  const onPaper = ({ box, x, y }, [atX, atY]) => [
    box[0] + box[2] * shareOf(x, atX), box[1] + box[3] * (1 - shareOf(y, atY)),
  ];
  const shareOf = ({ ends: [low, high], log }, value) =>
    log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  const valueOf = ({ ends: [low, high], log }, share) => log ? low * (high / low) ** share : low + share * (high - low);
  const linesOf = group => {  // markers where there are any: they are the data
    const marks = [...group.querySelectorAll("use")].map(mark => [[+mark.getAttribute("x"), +mark.getAttribute("y")]]);
    if (marks.length) return marks;
    const paths = [...group.querySelectorAll("path")].filter(path => !path.closest("defs"));
    return paths.flatMap(path => path.getAttribute("d").split("M").slice(1)).map(piece => {
      const sizes = (piece.match(/-?[\d.]+(?:e-?\d+)?/g) || []).map(Number);
      return sizes.flatMap((size, i) => i % 2 ? [[sizes[i - 1], size]] : []);
    });
  };

  // The point of a drawing that is nearest to a place on it, at a scale of so many pixels a unit.
  const nearest = (drawing, x, y, scale) => {
    const panel = drawing.panels.find(({ box: [left, top, wide, high] }) =>
      x >= left && x <= left + wide && y >= top && y <= top + high);
    let best = null, least = NEAR_PX / scale;
    for (const series of panel ? panel.series : []) for (const line of series.lines) line.forEach((end, i) => {
      const point = onLine(line[i - 1] || end, end, x, y, SNAP_PX / scale), far = Math.hypot(point[0] - x, point[1] - y);
      if (far < least) [best, least] = [{ panel, series, point }, far];
    });
    return best;
  };
  const onLine = ([ax, ay], [bx, by], x, y, snap) => {
    const long = Math.hypot(bx - ax, by - ay);
    if (!long) return [bx, by];
    const along = Math.min(Math.max(((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / long, 0), long);
    const share = along < snap ? 0 : long - along < snap ? 1 : along / long;  // a vertex is a sample, or nearly one
    return [ax + share * (bx - ax), ay + share * (by - ay)];
  };
  const said = (axis, share) => {
    const value = valueOf(axis, share), [, name, unit, more = ""] = /^(.*?)(?: \[([^\]]*)\](.*))?$/s.exec(axis.label);
    if (axis.words) return axis.words[Math.round(value)] || "";
    const digits = Math.min(Math.max(Math.ceil(3 - Math.log10(Math.abs(axis.ends[1] - axis.ends[0]))), 0), 8);
    return `${name}${more.replace(/\s+/g, " ")}: ${axis.log ? value.toPrecision(3) : value.toFixed(digits)} ${unit || ""}`.trim();
  };

  const mark = make("i", "mark"), note = make("output", "note");
  const hush = () => { mark.remove(); note.remove(); };
  const tell = (host, image, event) => {
    const drawing = drawingOf(image), rect = image.getBoundingClientRect(), at = host.getBoundingClientRect();
    const scale = drawing && Math.min(rect.width / drawing.width, rect.height / drawing.height);
    if (!scale) return hush();
    const left = rect.left + (rect.width - scale * drawing.width) / 2;
    const top = rect.top + (rect.height - scale * drawing.height) / 2;
    const near = nearest(drawing, (event.clientX - left) / scale, (event.clientY - top) / scale, scale);
    if (!near) return hush();
    const { panel: { box, x, y }, series, point } = near;
    const values = [said(x, (point[0] - box[0]) / box[2]), said(y, 1 - (point[1] - box[1]) / box[3])];
    note.textContent = [series.name, ...values].filter(Boolean).join("\n");
    const px = left + scale * point[0] - at.left, py = top + scale * point[1] - at.top;
    const [toLeft, above] = [px > at.width / 2, py > at.height / 2];
    for (const each of [mark, note]) Object.assign(each.style, { left: `${px}px`, top: `${py}px` });
    note.style.translate = `${toLeft ? "calc(-100% - 12px)" : "12px"} ${above ? "calc(-100% - 12px)" : "12px"}`;
    host.append(mark, note);
  };

  // One figure, as large as the window: wheel, pinch and + - zoom, drag and arrows move, 0 and a double click reset.
  const dialog = make("dialog", "zoom"), stage = make("div", "stage"), bar = make("div", "bar");
  const large = make("img", ""), caption = make("p", "");
  const pointers = new Map();
  let size = [1, 1], whole = 1, first = 1, view = { scale: 1, x: 0, y: 0 };
  const show = () => {
    large.style.width = `${size[0] * view.scale}px`;
    large.style.translate = `${view.x}px ${view.y}px`;
    hush();
  };
  const reset = () => {  // a narrow window shows a part whose letters can be read
    const fits = [stage.clientWidth / size[0], stage.clientHeight / size[1]];
    whole = Math.min(...fits);
    first = stage.clientWidth < NARROW_PX ? Math.max(...fits) : whole;
    view = { scale: first, x: Math.max(0, (stage.clientWidth - first * size[0]) / 2), y: Math.max(0, (stage.clientHeight - first * size[1]) / 2) };
    show();
  };
  const zoomBy = (factor, x = stage.clientWidth / 2, y = stage.clientHeight / 2) => {
    const scale = Math.min(Math.max(view.scale * factor, whole), MOST * whole), by = scale / view.scale;
    view = { scale, x: x - by * (x - view.x), y: y - by * (y - view.y) };
    show();
  };
  const moveBy = (x, y) => { view.x += x; view.y += y; show(); };
  const keys = {
    "+": () => zoomBy(STEP), "=": () => zoomBy(STEP), "-": () => zoomBy(1 / STEP), "0": reset,
    ArrowLeft: () => moveBy(60, 0), ArrowRight: () => moveBy(-60, 0), ArrowUp: () => moveBy(0, 60), ArrowDown: () => moveBy(0, -60),
  };
  const inside = event => { const { left, top } = stage.getBoundingClientRect(); return [event.clientX - left, event.clientY - top]; };
  dialog.onkeydown = event => { if (keys[event.key]) { event.preventDefault(); keys[event.key](); } };
  stage.addEventListener("wheel", event => { event.preventDefault(); zoomBy(Math.exp(-0.002 * event.deltaY), ...inside(event)); }, { passive: false });
  stage.ondblclick = reset;
  stage.onpointerdown = event => {
    pointers.set(event.pointerId, inside(event));
    try { stage.setPointerCapture(event.pointerId); } catch { /* it is up already */ }
    tell(stage, large, event);
  };
  stage.onpointerup = stage.onpointercancel = event => pointers.delete(event.pointerId);
  stage.onpointerleave = event => { if (event.pointerType === "mouse") hush(); };
  stage.onpointermove = event => {
    const [x, y] = inside(event), before = pointers.get(event.pointerId);
    const other = [...pointers].find(([id]) => id !== event.pointerId);
    if (before) pointers.set(event.pointerId, [x, y]);
    if (before && other) {
      const [ox, oy] = other[1], was = Math.hypot(before[0] - ox, before[1] - oy);
      zoomBy(Math.hypot(x - ox, y - oy) / Math.max(was, 1), (x + ox) / 2, (y + oy) / 2);
      moveBy((x - before[0]) / 2, (y - before[1]) / 2);
    } else if (before && (x !== before[0] || y !== before[1])) moveBy(x - before[0], y - before[1]);
    else if (!before) tell(stage, large, event);
  };
  const open = (image, words) => {
    const drawing = drawingOf(image);
    size = drawing ? [drawing.width, drawing.height] : [image.naturalWidth, image.naturalHeight];
    Object.assign(large, { src: image.src, alt: image.alt, draggable: false });
    caption.textContent = words;
    stage.append(large);
    pointers.clear();
    dialog.showModal();
    reset();
  };
  const button = (text, does, label) => {
    const made = make("button", "", text);
    Object.assign(made, { type: "button", onclick: does, ariaLabel: label });
    return made;
  };
  bar.append(
    button("−", keys["-"], "Smaller"), button("+", keys["+"], "Larger"), button("Reset", reset, "Reset"),
    button("Close", () => dialog.close(), "Close"), caption,
  );
  dialog.append(bar, stage);
  dialog.onclose = hush;
  addEventListener("resize", () => { hush(); if (dialog.open) reset(); });
  document.body.append(dialog);
  document.documentElement.classList.add("live");

  for (const figure of document.querySelectorAll("figure")) {
    const image = figure.querySelector("img"), words = figure.querySelector("figcaption").textContent;
    image.onclick = () => open(image, words);
    image.onpointermove = event => { if (event.pointerType === "mouse") tell(figure, image, event); };
    figure.onpointerleave = hush;
    figure.onkeydown = event => { if (event.key === "Enter" && event.target === figure) open(image, words); };
  }

  for (const group of document.querySelectorAll(".choice")) {
    const figures = [...group.querySelectorAll("figure")], label = make("label", "", "Show "), list = make("select", "");
    figures.forEach((figure, i) => {
      const words = figure.querySelector("figcaption").textContent, end = words.lastIndexOf(": ");
      list.add(new Option(end > 0 ? words.slice(0, end) : words, i));
    });
    const choose = () => figures.forEach((figure, i) => { figure.hidden = i !== list.selectedIndex; });
    Object.assign(list, { onchange: choose, autocomplete: "off", selectedIndex: 0 });
    label.append(list);
    group.prepend(label);
    choose();
  }
})();
