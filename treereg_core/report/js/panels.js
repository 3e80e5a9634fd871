// What the page says in words and tables.

function fillHeader(model) {
  const { data } = model;
  const { registration } = data;
  const badge = byId("badge");
  badge.textContent = registration.verdict;
  badge.classList.add(["accepted", "ambiguous"].includes(registration.verdict) ? registration.verdict : "failed");
  byId("names").textContent = `${model.source.name} laid on ${model.reference.name}`;
  document.title = `treereg: ${model.source.name} on ${model.reference.name}, ${registration.verdict}`;
  byId("headline").textContent = data.headline;
  byId("sentence").textContent = data.sentence;
  byId("reason").textContent = `The judge: ${registration.reason}`;
  byId("warnings").append(...(data.warnings ?? []).map((text) => element("li", text)));
  fillFigures(figures(model));
}

function figures(model) {
  const { registration } = model.data;
  const found = [];
  const error = registration.expected_error_m;
  if (error) found.push(["Expected error", metres(error.rms), `95 %: ${metres(error.ci95[0])} to ${metres(error.ci95[1])}`]);
  if (model.after >= 0) found.push(["Chance that it is wrong", model.data.chance_wrong]);
  const used = Math.min(registration.reference.used, registration.source.used);
  found.push(["Trees matched", `${number(registration.matched, 0)}`, `of ${number(used, 0)}; before ${number(registration.before.matched, 0)}`]);
  if (model.after >= 0) {
    const counts = countsOf(model.placements[model.after]);
    found.push(["In one survey only", `${number(counts.missing, 0)} + ${number(counts.new, 0)}`, "missing and new, where both look"]);
    const { transform } = registration;
    const [east, north] = transform.translation_m;
    found.push(["Moved", metres(Math.hypot(east, north)), `${number(Math.abs(east), 2)} m ${east < 0 ? "west" : "east"}, ${number(Math.abs(north), 2)} m ${north < 0 ? "south" : "north"}`]);
    found.push(["Turned", `${number(transform.rotation_deg, 3)}°`, transform.scale ? `scale ${number(transform.scale, 5)}` : "counter-clockwise"]);
  }
  return found;
}

function countsOf(placement) {
  const lone = (list) => list.filter((partner) => partner === ALONE).length;
  return { missing: lone(placement.reference), new: lone(placement.source) };
}

function fillRivals(model, lay) {
  const rivals = model.data.registration.rivals;
  byId("rivals-section").hidden = rivals.length === 0;
  byId("rivals-text").textContent = "These are the best other placements. Lay one to see how its trees meet; if you know "
    + "that one of them is right, treereg apply --rival N moves files by it.";
  const header = element("tr");
  for (const [text, kind] of [["Placement"], ["Trees matched", "number"], ["Apart (RMS)", "number"], ["From the chosen one", "number"], ["How likely", ""], [""]]) {
    header.append(element("th", text, kind));
  }
  byId("rivals").replaceChildren(header, ...model.placements.flatMap((placement, index) => {
    if (index < model.after || index === 0) return [];
    const line = element("tr", undefined, index === model.after ? "chosen" : "");
    const button = element("button", "Lay it");
    button.type = "button";
    button.setAttribute("aria-label", `Lay ${placement.label}`);
    button.addEventListener("click", () => lay(index));
    const action = element("td");
    action.append(button);
    line.append(
      element("td", index === model.after ? "Chosen" : placement.label),
      element("td", number(placement.matched, 0), "number"),
      element("td", metres(placement.residual_rms_m), "number"),
      element("td", index === model.after ? "–" : metres(placement.apart_m), "number"),
      element("td", index === model.after ? "the most likely" : odds(rivals[index - model.after - 1].log_odds)),
      action,
    );
    return [line];
  }));
}

function odds(logOdds) {
  if (logOdds < -Math.log(1e6)) return "over a million times less likely";
  const times = Math.exp(Math.abs(logOdds));
  if (times < 1.5) return "about as likely";
  return `${d3.format(",.2~r")(times)} times ${logOdds < 0 ? "less" : "more"} likely`;
}

function fillTables(model) {
  const { registration, timings_s: timings } = model.data;
  const sides = [registration.reference, registration.source];
  fillTable("surveys", [
    ["Folder", ...sides.map((side) => side.path ?? "–")],
    ["Trees in the file", ...sides.map((side) => number(side.features, 0))],
    ["Trees used", ...sides.map((side) => number(side.used, 0))],
    ["Orthomosaic", ...[model.reference, model.source].map((survey) => (survey.image ? "shown" : "–"))],
  ], ["", "Reference", "Source"]);
  const offset = registration.vertical_offset_m;
  fillTable("method", [
    ["Method", registration.method], ["Start", registration.start], ["Model", registration.transform?.model ?? "–"],
    ["Seed", registration.seed], ["Coordinates", registration.crs ?? "–"], ["treereg", registration.version],
    ["Plugins", Object.values(registration.plugins).join(", ")],
    ...(offset ? [["Elevations", `source ${number(offset.median, 2)} m off, spread ${number(offset.spread, 2)} m; not applied`]] : []),
  ]);
  fillTable("timings", Object.entries(timings).map(([name, seconds]) => [name, number(seconds, 2)]), ["Stage", "Seconds"], true);
  fillSettings(registration.settings);
}

// A tree's numbers, name and value, under the placement that is shown.
function treeFacts(model, placement, { role, tree }) {
  const survey = model.surveys[role];
  const other = role === "reference" ? model.source : model.reference;
  const facts = Object.entries(survey.quantities).map(([name, values]) => [
    inWords(name), name === "area_m2" ? number(values[tree], 1) : number(values[tree], 2),
  ]);
  if (survey.row[tree] >= 0) facts.push(["row, tree", `${survey.row[tree] + 1}, ${survey.placeInRow[tree] + 1}`]);
  const partner = placement[role][tree];
  if (partner >= 0) {
    const [east, north] = residual(model, placement, role === "source" ? tree : partner);
    facts.push([`partner in ${other.name}`, `tree ${other.id[partner]}`], ["distance", metres(Math.hypot(east, north))]);
  } else {
    const words = { missing: `none in ${other.name}`, new: `none in ${other.name}`, unseen: `${other.name} does not cover it` };
    facts.push(["partner", words[statusOf(placement, role, tree)]]);
  }
  return { title: `Tree ${survey.id[tree]} of ${survey.fullName}`, facts };
}

// What colours and signs on the map mean.
function legendOf(model, { layers, heat, exaggeration }, { colouring, colours, placement }) {
  const entries = [...colouring.legend];
  const line = (text, colour) => entries.push({ text, colour, line: true });
  const sign = (symbol, text, colour) => entries.push({ symbol, text, colour });
  if (heat !== "none") entries.push(...ramp(model, heat).legend.map((one) => ({ ...one, text: `heat map, ${one.text}` })));
  const counts = countsOf(placement);
  if (layers.alone) sign("✕", `missing in ${model.source.name} (${counts.missing})`, WONG.vermillion);
  if (layers.alone) sign("+", `new in ${model.source.name} (${counts.new})`, WONG.purple);
  if (layers.gaps && available(model, "gaps")) sign("◇", `gaps in rows (${model.rows.gaps.length})`, colours.ink);
  if (layers.pairs) line("from where a tree lies now to its partner", WONG.green);
  if (layers.residuals) line(`residuals, drawn ${exaggeration} times as long`, colours.ink);
  if (layers.rows) line("rows of the reference; dashed: of the source, in the colour of the same row", ROW_COLOURS[0]);
  return entries;
}
