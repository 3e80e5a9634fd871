// Elements of a page, filled with its data. All text from the data goes through `textContent`.

const readData = () => JSON.parse(document.getElementById("data").textContent);
const number = (value, digits) => (value === null || value === undefined ? "–" : d3.format(`,.${digits}f`)(value));
const metres = (value) => (value === null || value === undefined ? "–" : value < 1 ? `${number(100 * value, 1)} cm` : `${number(value, 2)} m`);

function element(tag, text, className) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (className) made.className = className;
  return made;
}

function byId(id) {
  return document.getElementById(id);
}

function fillTable(id, rows, header, numeric = false) {
  const cell = (tag, value, right) => element(tag, String(value), right ? "number" : "");
  const table = byId(id);
  table.replaceChildren();
  if (header) {
    const line = element("tr");
    header.forEach((text, k) => line.append(cell("th", text, numeric && k > 0)));
    table.append(line);
  }
  for (const [name, ...values] of rows) {
    const line = element("tr");
    line.append(cell("th", name, false), ...values.map((value) => cell("td", value, numeric)));
    table.append(line);
  }
}

function showTip(tip, { title, facts }) {
  const list = element("dl");
  for (const [name, value] of facts) list.append(element("dt", name), element("dd", value));
  tip.replaceChildren(element("strong", title), list);
  tip.hidden = false;
}

// Beside a point of the stage, and inside it.
function placeTip(tip, [x, y], width, height) {
  const [w, h] = [tip.offsetWidth, tip.offsetHeight];
  const left = x + 16 + w < width ? x + 16 : Math.max(4, x - 16 - w);
  const top = Math.min(Math.max(4, y - h / 2), Math.max(4, height - h - 4));
  tip.style.left = `${width < 480 ? 4 : left}px`;
  tip.style.top = `${width < 480 ? (y > height / 2 ? 4 : height - h - 4) : top}px`;
}

function fillLegend(entries) {
  byId("legend").replaceChildren(...entries.map(({ text, colour, ramp, line, symbol, hollow }) => {
    const item = element("li");
    const swatch = element("i", symbol, ramp ? "ramp" : line ? "line" : symbol ? "sign" : "");
    if (ramp) swatch.style.background = `linear-gradient(90deg, ${d3.range(9).map((k) => ramp(k / 8)).join(",")})`;
    else if (line) swatch.style.borderColor = colour;
    else if (symbol) swatch.style.color = colour;
    else Object.assign(swatch.style, { background: hollow ? "transparent" : colour, borderColor: colour });
    item.append(swatch, element("span", text));
    return item;
  }));
}

function fillSelect(id, options, value, chosen) {
  const select = byId(id);
  select.append(...options.map(([name, text]) => Object.assign(element("option", text), { value: name })));
  select.value = value;
  select.addEventListener("change", () => chosen(select.value));
}

// Buttons of which one is pressed; `choose` is given its number.
function fillSegments(id, name, texts, chosen, choose) {
  byId(id).append(...texts.map((text, value) => {
    const label = element("label");
    const radio = Object.assign(element("input"), { type: "radio", name, value, checked: value === chosen });
    radio.addEventListener("change", () => choose(value));
    label.append(radio, element("span", text));
    return label;
  }));
}

function fillFigures(figures) {
  byId("figures").append(...figures.map(([name, value, more]) => {
    const figure = element("div");
    const description = element("dd", value);
    if (more) description.append(element("small", more));
    figure.append(element("dt", name), description);
    return figure;
  }));
}

function fillSettings(settings) {
  fillTable("settings", Object.entries(settings).flatMap(([stage, values]) =>
    Object.entries(values ?? {}).map(([name, value]) => [`${stage}.${name}`, typeof value === "string" ? value : JSON.stringify(value)])));
}
