// Drawing on the canvas. A view has `scale` (pixels to the metre), `left`, `top` (where the origin lies), `width`,
// `height`.

// What takes long is a generator that yields between batches.

const BATCH = 48; // canopies filled as one path: one huge path is slow, one path for each is too
const SQUARES = 2.2; // pixels: crowns of a smaller radius are drawn as squares,
const STROKED = 4; // and those of a larger one have an edge
const FAINT = 0.3; // opacity of small crowns on an image or heat map
const LINES = 400;
const MARK = 5;
const SCALE_BAR = 120; // pixels at most

function finish(steps) {
  while (!steps.next().done);
}

function screenFrom(view) {
  return { a: view.scale, b: 0, c: 0, d: -view.scale, e: view.left, f: view.top };
}

// The trees of a survey that can be seen, by colour.
function visibleByColour(view, survey, toScreen, colourOf) {
  const groups = new Map();
  const margin = 12 * view.scale + MARK;
  for (let i = 0; i < survey.size; i++) {
    const sx = toScreen.a * survey.x[i] + toScreen.c * survey.y[i] + toScreen.e;
    const sy = toScreen.b * survey.x[i] + toScreen.d * survey.y[i] + toScreen.f;
    if (sx < -margin || sy < -margin || sx > view.width + margin || sy > view.height + margin) continue;
    const colour = colourOf(survey, i);
    const group = groups.get(colour);
    if (group) group.push(i);
    else groups.set(colour, [i]);
  }
  return groups;
}

function* drawCrowns(ctx, view, survey, transform, look) {
  const toScreen = compose(screenFrom(view), transform);
  const usual = survey.usualRadius * view.scale;
  const drawBatch = usual < SQUARES ? drawSquares : drawOutlines;
  const small = usual < STROKED;
  const fill = small ? Math.max(1.2 * look.fill, FAINT) : look.fill;
  const lineWidth = small ? 0 : look.lineWidth;
  for (const [colour, trees] of visibleByColour(view, survey, toScreen, look.colourOf)) {
    for (let begin = 0; begin < trees.length; begin += BATCH) {
      ctx.fillStyle = ctx.strokeStyle = colour;
      drawBatch(ctx, survey, trees.slice(begin, begin + BATCH), toScreen, { scale: view.scale, fill, lineWidth });
      yield;
    }
  }
  ctx.globalAlpha = 1;
}

function drawSquares(ctx, survey, trees, t, { scale, fill }) {
  ctx.globalAlpha = fill;
  for (const i of trees) {
    const r = Math.max(survey.radius[i] * scale * 0.89, 0.7);
    const sx = t.a * survey.x[i] + t.c * survey.y[i] + t.e;
    const sy = t.b * survey.x[i] + t.d * survey.y[i] + t.f;
    ctx.fillRect(sx - r, sy - r, 2 * r, 2 * r);
  }
}

function drawOutlines(ctx, survey, trees, t, { scale, fill, lineWidth }) {
  ctx.beginPath();
  for (const i of trees) addCrown(ctx, survey, i, t, scale);
  if (fill > 0) {
    ctx.globalAlpha = fill;
    ctx.fill();
  }
  ctx.globalAlpha = 0.95;
  ctx.lineWidth = lineWidth;
  if (lineWidth > 0) ctx.stroke();
}

function addCrown(ctx, survey, i, t, scale) {
  const outline = survey.outline;
  if (!outline) {
    const [sx, sy] = moved(t, survey.x[i], survey.y[i]);
    const r = survey.radius[i] * scale;
    ctx.moveTo(sx + r, sy);
    ctx.arc(sx, sy, r, 0, 2 * Math.PI);
    return;
  }
  const { start, first, xy } = outline;
  for (let ring = first[i]; ring < first[i + 1]; ring++) {
    for (let k = start[ring]; k < start[ring + 1]; k++) {
      const x = xy[2 * k];
      const y = xy[2 * k + 1];
      const sx = t.a * x + t.c * y + t.e;
      const sy = t.b * x + t.d * y + t.f;
      if (k === start[ring]) ctx.moveTo(sx, sy);
      else ctx.lineTo(sx, sy);
    }
    ctx.closePath();
  }
}

function* drawLines(ctx, view, lines, colour, width) {
  const t = screenFrom(view);
  for (let begin = 0; begin < lines.length; begin += LINES) {
    ctx.strokeStyle = colour;
    ctx.lineWidth = width;
    ctx.beginPath();
    for (const line of lines.slice(begin, begin + LINES)) {
      line.forEach(([x, y], k) => ctx[k ? "lineTo" : "moveTo"](...moved(t, x, y)));
    }
    ctx.stroke();
    yield;
  }
}

function drawRows(ctx, view, model, transform) {
  const line = (survey, trees, t) => trees.map((i) => moved(t, survey.x[i], survey.y[i]));
  model.rows.reference.forEach((trees, row) => {
    const colour = ROW_COLOURS[row % ROW_COLOURS.length];
    finish(drawLines(ctx, view, [line(model.reference, trees, IDENTITY)], colour, 2));
  });
  ctx.setLineDash([5, 4]);
  model.rows.source.forEach((trees, row) => {
    const partner = model.rows.partner[row];
    const colour = partner < 0 ? WONG.grey : ROW_COLOURS[partner % ROW_COLOURS.length];
    finish(drawLines(ctx, view, [line(model.source, trees, transform)], colour, 1.5));
  });
  ctx.setLineDash([]);
}

// Crosses for trees that the other survey lacks, plus signs for new ones, diamonds for gaps; small from afar.
function* drawMarks(ctx, view, points, { shape, colour, paper }) {
  const t = screenFrom(view);
  const r = Math.max(1.5, Math.min(MARK, 0.6 * view.scale));
  const passes = r < 3 ? [[1.5, colour]] : [[4, paper], [2, colour]];
  const seen = points.map(([x, y]) => moved(t, x, y))
    .filter(([sx, sy]) => sx > -r && sy > -r && sx < view.width + r && sy < view.height + r);
  for (let begin = 0; begin < seen.length; begin += LINES) {
    for (const [width, stroke] of passes) {
      ctx.lineWidth = width;
      ctx.strokeStyle = stroke;
      ctx.beginPath();
      for (const [sx, sy] of seen.slice(begin, begin + LINES)) {
        for (const line of MARKS[shape]) {
          line.forEach(([dx, dy], k) => ctx[k ? "lineTo" : "moveTo"](sx + r * dx, sy + r * dy));
        }
      }
      ctx.stroke();
    }
    yield;
  }
}

const MARKS = {
  cross: [[[-1, -1], [1, 1]], [[-1, 1], [1, -1]]],
  plus: [[[-1.2, 0], [1.2, 0]], [[0, -1.2], [0, 1.2]]],
  diamond: [[[0, -1.4], [1.4, 0], [0, 1.4], [-1.4, 0], [0, -1.4]]],
};

function alone(model, placement, role, transform) {
  const survey = model.surveys[role];
  const points = [];
  placement[role].forEach((partner, i) => {
    if (partner === ALONE) points.push(moved(transform, survey.x[i], survey.y[i]));
  });
  return points;
}

function drawImage(ctx, view, picture, survey, transform) {
  const t = compose(screenFrom(view), compose(transform, affine(survey.image.matrix)));
  ctx.save();
  ctx.transform(t.a, t.b, t.c, t.d, t.e, t.f);
  ctx.imageSmoothingEnabled = true;
  ctx.drawImage(picture, 0, 0, survey.image.width, survey.image.height);
  ctx.restore();
}

// A bar of a round length, for the map, or for residuals drawn so many times as long.
function drawScale(ctx, view, { times, what, lift }, { ink, paper }) {
  const metres = roundLength(SCALE_BAR / view.scale / times);
  const length = metres * times * view.scale;
  const text = `${d3.format("~g")(metres)} m${what}`;
  const x = 14;
  const y = view.height - 14 - lift;
  ctx.font = "12px system-ui, sans-serif";
  ctx.lineJoin = "round";
  for (const [width, colour] of [[5, paper], [2, ink]]) {
    ctx.lineWidth = width;
    ctx.strokeStyle = colour;
    ctx.beginPath();
    ctx.moveTo(x, y - 4);
    ctx.lineTo(x, y);
    ctx.lineTo(x + length, y);
    ctx.lineTo(x + length, y - 4);
    ctx.stroke();
    if (colour === paper) ctx.strokeText(text, x + length + 8, y);
  }
  ctx.fillStyle = ink;
  ctx.fillText(text, x + length + 8, y);
}

function roundLength(metres) {
  const power = 10 ** Math.floor(Math.log10(metres));
  return [5, 2, 1].map((step) => step * power).find((length) => length <= metres) ?? power;
}
