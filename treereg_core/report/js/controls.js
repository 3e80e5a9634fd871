// The controls beside the map; each changes the state and asks for it to be drawn.

const LAYERS = [
  ["reference", "Reference canopies"], ["source", "Source canopies"], ["pairs", "Matched pairs"],
  ["residuals", "Residual vectors"], ["alone", "Missing and new trees"], ["rows", "Rows"], ["gaps", "Gaps in rows"],
  ["boundary", "Boundary"],
];
const EXAGGERATIONS = [1, 2, 5, 10, 20, 50, 100];

function available(model, layer) {
  if (layer === "rows") return Boolean(model.rows);
  if (layer === "gaps") return Boolean(model.rows?.gaps.length);
  if (layer === "boundary") return model.boundary.length > 0;
  if (layer === "pairs") return model.after >= 0;
  return true;
}

function fillLayers(model, state, changed) {
  for (const [name, text] of LAYERS) {
    const label = element("label");
    const box = Object.assign(element("input"), { type: "checkbox", name, checked: state.layers[name] });
    box.disabled = !available(model, name);
    box.addEventListener("change", () => changed(() => { state.layers[name] = box.checked; }));
    const why = box.disabled && name === "rows" ? " (the method looks for none)" : "";
    label.append(box, element("span", text + why));
    byId("layers").append(label);
  }
}

function colourChoices(model) {
  return [
    ["survey", "by survey"], ["match", "by match"], ...(model.rows ? [["row", "by row"]] : []),
    ...quantitiesOf(model).map((name) => [name, `by ${inWords(name)}`]),
  ];
}

function imageChoices(model) {
  const { reference, source } = model;
  return [
    ["none", "none"],
    ...(reference.image ? [["reference", `of ${reference.name}`]] : []),
    ...(source.image ? [["source", `of ${source.name}, as placed`]] : []),
    ...(reference.image && source.image ? [["swipe", "swipe between both"]] : []),
  ];
}

function fillControls(model, state, changed) {
  fillSelect("colour", colourChoices(model), state.colour, (value) => changed(() => { state.colour = value; }));
  fillSelect("heat", [["none", "none"], ...quantitiesOf(model).map((name) => [name, inWords(name)])], "none",
    (value) => changed(() => { state.heat = value; }));
  fillSelect("image", imageChoices(model), state.image, (value) => changed(() => { state.image = value; }));
  byId("image-row").hidden = imageChoices(model).length === 1;
  fillLayers(model, state, changed);
  const slider = byId("exaggeration");
  slider.addEventListener("input", () => changed(() => { state.exaggeration = EXAGGERATIONS[slider.value]; }));
  byId("swipe-left").textContent = `◀ ${model.reference.name}`;
  byId("swipe-right").textContent = `${model.source.name} ▶`;
  byId("controls").addEventListener("submit", (event) => event.preventDefault());
}

function fillPlacements(model, state, lay) {
  fillSegments("placements", "placement", model.placements.map(({ label }) => label), state.placement, lay);
  byId("play").disabled = model.placements.length < 2;
}
