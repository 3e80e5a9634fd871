// What the page says in words and tables.

const WORDS = ["present", "missing", "new", "replanted", "unseen"];

function fillHeader({ series, timeline }) {
  const [first, last] = [timeline[0], timeline.at(-1)];
  const accepted = timeline.length - 1;
  const others = series.surveys.length - 1;
  const counts = last.said.states;
  document.title = `treereg series: ${first.name} to ${last.name}`;
  byId("names").textContent = series.surveys.map((survey) => survey.name).join(" · ");
  byId("headline").textContent = `${number(series.probable_trees, 0)} trees through ${timeline.length} surveys`;
  byId("sentence").textContent = accepted
    ? `${accepted} of ${others} surveys lie on ${first.name}. The last of them, ${last.name}, shows `
      + `${number(counts.present + counts.new + counts.replanted, 0)} trees; ${number(counts.missing, 0)} that stood before are missing, `
      + `and ${number(counts.unseen, 0)} stand where it does not look.`
    : `No survey could be laid on ${first.name}, so only its own trees are shown.`;
  const sum = (state) => d3.sum(timeline, (survey) => survey.said.states[state]);
  const growth = d3.median((last.growth.first ?? []).filter((share) => share !== null));
  fillFigures([
    ["Trees", number(series.probable_trees, 0), `in ${number(series.rows, 0)} rows`],
    ["Missing at the end", number(counts.missing, 0), `in ${last.name}`],
    ["New", number(sum("new"), 0), "or missed before"],
    ["Replanted", number(sum("replanted"), 0), "in all surveys"],
    ["Crowns", percent(growth ?? null), `median, ${first.name} to ${last.name}`],
  ]);
}

function fillTables({ series, timeline }) {
  let k = 0;
  fillTable("all", series.surveys.map((said) => {
    const survey = said.states ? timeline[k++] : null;
    const counts = WORDS.map((state) => number(said.states?.[state], 0));
    const growth = d3.median((survey?.growth.previous ?? []).filter((share) => share !== null));
    return [said.name, said.verdict, metres(said.expected_error_m), ...counts, percent(growth ?? null), said.verdict === "reference" ? "–" : said.reason];
  }), ["Survey", "Verdict", "Expected error", ...WORDS.map((word) => word[0].toUpperCase() + word.slice(1)), "Growth", "Reason"]);
  fillTable("method", [
    ["Method", series.method], ["Start", series.start], ["Seed", series.seed], ["Coordinates", series.crs ?? "–"],
    ["treereg", series.version], ["Plugins", Object.values(series.plugins).join(", ")],
  ]);
  fillSettings(series.settings);
}

function fillChoices(model, { choose, changed }, state) {
  fillSegments("chosen", "survey", model.timeline.map(({ name }) => name), state.survey, choose);
  byId("play").disabled = model.timeline.length < 2;
  fillSelect("colour", Object.entries(MODES), state.colour, (value) => changed(() => { state.colour = value; }));
  for (const name of WORDS) {
    const label = element("label");
    const box = Object.assign(element("input"), { type: "checkbox", name, checked: true });
    box.addEventListener("change", () => changed(() => { state.layers[name] = box.checked; }));
    label.append(box, element("span", name));
    byId("layers").append(label);
  }
  byId("controls").addEventListener("submit", (event) => event.preventDefault());
}

function legendOf({ survey, scale, state }) {
  if (scale) return scale.legend;
  const counts = survey.said.states;
  return WORDS.filter((name) => state.layers[name]).map((name) => ({ ...STATES[name], text: `${name} (${number(counts[name], 0)})` }));
}

const titleOf = ({ trees }, tree) => `Tree ${trees.number[tree]}`
  + (trees.row[tree] < 0 ? ", in no row" : `: row ${trees.row[tree] + 1}, tree ${trees.place[tree] + 1}`);

// A tree's numbers in the survey that is shown.
function treeFacts(model, survey, tree) {
  const facts = [["survey", survey.name], ["state", survey.state[tree]]];
  if (survey.area_m2[tree] !== null) facts.push(["crown", `${number(survey.area_m2[tree], 1)} m²`]);
  if (survey.height_m[tree] !== null) facts.push(["height", `${number(survey.height_m[tree], 1)} m`]);
  const growth = survey.growth.previous?.[tree] ?? null;
  if (growth !== null) facts.push(["since the survey before", percent(growth)]);
  const all = survey.growth.first?.[tree] ?? null;
  if (all !== null) facts.push(["since the first", percent(all)]);
  return { title: titleOf(model, tree), facts };
}

// A tree's history: a chart and a table.
function showHistory(model, tree, colours) {
  byId("tree").hidden = tree === null;
  byId("tree-text").textContent = tree === null ? "Choose a tree on the map." : titleOf(model, tree);
  if (tree === null) return;
  drawChart(model, tree, colours);
  fillTable("history", model.timeline.map((survey) => [
    survey.name, survey.state[tree], number(survey.area_m2[tree], 1), number(survey.height_m[tree], 1),
    percent(survey.growth.previous?.[tree] ?? null), percent(survey.growth.first?.[tree] ?? null), number(survey.confidence[tree], 2),
  ]), ["Survey", "State", "Crown, m²", "Height, m", "Since the survey before", "Since the first", "Confidence"]);
}
