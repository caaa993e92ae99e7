// A Q-network, as in network.py and beyond/global_local.py, and how it learns: gradients and Adam.
// tests/labs compares all with PyTorch's. A batch has n rows, and each layer its own buffers:
// `forward(x, n)` gives the layer's output, `backward(slopes, n)` the gradients of its weights and,
// from the slopes of what comes out, those of what goes in.

import { ACTIONS } from "./world.js";

const NO_FLY_LAYER = 1; // of the map; outside the city it is 1, and every other layer 0
const zeros = (length) => new Float64Array(length); // which engines multiply faster than 32 bits

/** Weights of a layer, by their name in PyTorch, their gradient and what Adam keeps of it. */
class Weights {
  constructor(name, shape, values, learns) {
    Object.assign(this, { name, shape, values });
    for (const part of learns ? ["gradient", "moment", "square", "largest"] : [])
      this[part] = zeros(values.length);
  }
}

/**
 * c[i, j] = c0[j] + Σ a[i, k] b[j, k] over `inner` values of k. Of a and b the steps are told, from
 * one i or j to the next and from one k to the next, so that either may be transposed. Two rows by
 * four are summed at once, so that what is read serves several sums; where rows end, the last comes
 * again. Each sum is a variable of its own, because engines make fast code of that alone.
 */
function product([a, ai, ak], [b, bj, bk], c, rows, cols, inner, c0 = null) {
  for (let j = 0; j < cols; j += 4) {
    const j1 = Math.min(j + 1, cols - 1);
    const j2 = Math.min(j + 2, cols - 1);
    const j3 = Math.min(j + 3, cols - 1);
    const to1 = (j1 - j) * bj;
    const to2 = (j2 - j) * bj;
    const to3 = (j3 - j) * bj;
    for (let i = 0; i < rows; i += 2) {
      const below = Math.min(i + 1, rows - 1);
      const down = (below - i) * ai;
      let s0 = c0 ? c0[j] : 0;
      let s1 = c0 ? c0[j1] : 0;
      let s2 = c0 ? c0[j2] : 0;
      let s3 = c0 ? c0[j3] : 0;
      let t0 = s0;
      let t1 = s1;
      let t2 = s2;
      let t3 = s3;
      let p = i * ai;
      let q = j * bj;
      for (let k = 0; k < inner; k++) {
        const x = a[p];
        const y = a[p + down];
        const w0 = b[q];
        const w1 = b[q + to1];
        const w2 = b[q + to2];
        const w3 = b[q + to3];
        s0 += x * w0;
        t0 += y * w0;
        s1 += x * w1;
        t1 += y * w1;
        s2 += x * w2;
        t2 += y * w2;
        s3 += x * w3;
        t3 += y * w3;
        p += ak;
        q += bk;
      }
      const above = i * cols;
      const under = below * cols;
      c[above + j] = s0;
      c[above + j1] = s1;
      c[above + j2] = s2;
      c[above + j3] = s3;
      c[under + j] = t0;
      c[under + j1] = t1;
      c[under + j2] = t2;
      c[under + j3] = t3;
    }
  }
}

/** Fully connected; the first weights are Glorot's uniform ones. */
class Linear {
  /** @param {{batch: number, generator: object | null}} how see `QNetwork` */
  constructor(name, inputs, outputs, { batch, generator }, fan = [inputs, outputs], shape = null) {
    Object.assign(this, { inputs, outputs, out: zeros(batch * outputs) });
    const most = Math.sqrt(6 / (fan[0] + fan[1]));
    const values = zeros(inputs * outputs);
    if (generator) values.forEach((_, k) => (values[k] = generator.uniform(-most, most)));
    this.weight = new Weights(`${name}.weight`, shape ?? [outputs, inputs], values, generator);
    this.bias = new Weights(`${name}.bias`, [outputs], zeros(outputs), generator);
    this.weights = [this.weight, this.bias];
    this.slopes = zeros(generator ? batch * inputs : 0);
  }

  forward(x, n) {
    const { inputs, outputs, out, weight, bias } = this;
    product([x, inputs, 1], [weight.values, inputs, 1], out, n, outputs, inputs, bias.values);
    this.x = x;
    return out;
  }

  backward(slopes, n) {
    const { inputs, outputs, weight } = this;
    product([slopes, 1, outputs], [this.x, 1, inputs], weight.gradient, outputs, inputs, n);
    const bias = this.bias.gradient.fill(0);
    for (let row = 0; row < n; row++)
      for (let k = 0; k < outputs; k++) bias[k] += slopes[row * outputs + k];
    if (this.first) return null; // nothing is before it
    product([slopes, outputs, 1], [weight.values, 1, inputs], this.slopes, n, inputs, outputs);
    return this.slopes;
  }
}

/** Puts into each row of a batch what stands at some places of the row before. */
class Gather {
  weights = [];

  constructor(places, length, { batch, generator }) {
    Object.assign(this, { places: Int32Array.from(places), length });
    this.out = zeros(batch * places.length);
    this.slopes = zeros(generator ? batch * length : 0);
  }

  forward(x, n) {
    const { places, length, out } = this;
    for (let row = 0, at = 0; row < n; row++)
      for (let k = 0; k < places.length; k++) out[at++] = x[row * length + places[k]];
    return out;
  }

  backward(slopes, n) {
    const { places, length } = this;
    this.slopes.fill(0);
    for (let row = 0, at = 0; row < n; row++)
      for (let k = 0; k < places.length; k++) this.slopes[row * length + places[k]] += slopes[at++];
    return this.slopes;
  }
}

/** Kernels over each place of a map, no padding: what is under one, fully connected. */
class Convolution {
  /** @param {(channel: number, cell: number) => number} at where the map has it */
  constructor(name, channels, width, { kernels, kernel_size: side }, stride, how, at) {
    this.width = Math.floor((width - side) / stride) + 1;
    this.places = this.width * this.width; // of ** engines keep floats, which index slowly
    const area = side * side;
    const under = [];
    for (let place = 0; place < this.places; place++) {
      const corner =
        Math.floor(place / this.width) * stride * width + (place % this.width) * stride;
      for (let channel = 0; channel < channels; channel++)
        for (let tap = 0; tap < area; tap++)
          under.push(at(channel, corner + Math.floor(tap / side) * width + (tap % side)));
    }
    this.gather = new Gather(under, channels * width * width, how);
    const rows = { ...how, batch: how.batch * this.places };
    const fan = [channels * area, kernels * area];
    const shape = [kernels, channels, side, side];
    this.linear = new Linear(name, channels * area, kernels, rows, fan, shape);
    this.weights = this.linear.weights;
  }

  forward(x, n) {
    return this.linear.forward(this.gather.forward(x, n), n * this.places);
  }

  backward(slopes, n) {
    const before = this.linear.backward(slopes, n * this.places);
    return before && this.gather.backward(before, n);
  }
}

class LayerNorm {
  constructor(name, units, { batch, generator }) {
    this.units = units;
    this.weight = new Weights(`${name}.weight`, [units], zeros(units).fill(1), generator);
    this.bias = new Weights(`${name}.bias`, [units], zeros(units), generator);
    this.weights = [this.weight, this.bias];
    for (const buffer of ["out", "normal", "slopes"]) this[buffer] = zeros(batch * units);
    this.scale = zeros(batch);
  }

  forward(x, n) {
    const { units, out, normal, scale, weight, bias } = this;
    for (let row = 0; row < n; row++) {
      const there = row * units;
      let [mean, variance] = [0, 0];
      for (let k = 0; k < units; k++) mean += x[there + k];
      mean /= units;
      for (let k = 0; k < units; k++) variance += (x[there + k] - mean) ** 2;
      scale[row] = 1 / Math.sqrt(variance / units + 1e-5);
      for (let k = 0; k < units; k++) {
        normal[there + k] = (x[there + k] - mean) * scale[row];
        out[there + k] = normal[there + k] * weight.values[k] + bias.values[k];
      }
    }
    return out;
  }

  backward(slopes, n) {
    const { units, normal, scale, weight } = this;
    const [gradient, bias] = [weight.gradient.fill(0), this.bias.gradient.fill(0)];
    for (let row = 0; row < n; row++) {
      const there = row * units;
      let [mean, along] = [0, 0];
      for (let k = 0; k < units; k++) {
        const [slope, own] = [slopes[there + k], normal[there + k]];
        bias[k] += slope;
        gradient[k] += slope * own;
        mean += slope * weight.values[k];
        along += slope * weight.values[k] * own;
      }
      for (let k = 0; k < units; k++) {
        const slope = slopes[there + k] * weight.values[k];
        this.slopes[there + k] = scale[row] * (slope - (mean + normal[there + k] * along) / units);
      }
    }
    return this.slopes;
  }
}

/** Multiplies what is negative, in place, by a slope: 0 makes it the plain ReLU. */
class LeakyRelu {
  weights = [];

  constructor(leak) {
    this.leak = leak;
  }

  forward(x) {
    for (let at = 0; at < x.length; at++) if (x[at] < 0) x[at] *= this.leak;
    this.x = x;
    return x;
  }

  backward(slopes) {
    for (let at = 0; at < slopes.length; at++) if (this.x[at] <= 0) slopes[at] *= this.leak;
    return slopes;
  }
}

/** Q-values of all actions: convolutions of one map or two, then fully connected layers. */
export class QNetwork {
  /**
   * @param {object} recipe its layers
   * @param {number} channels of the map
   * @param {number} width of the map, cells
   * @param {{batch: number, generator: object | null}} how the most rows at a time, and a `Portable`
   *   for the first weights; null: it does not learn
   */
  constructor(recipe, channels, width, how) {
    const { kernels, strides, hidden, layer_norm, leak, pooling } = recipe;
    const views = viewsOf(zeros(channels * width ** 2), width, recipe);
    let inputs = 1; // the flying time
    /** Layers of each view, whose features begin at `from` of the head's inputs. */
    this.branches = views.map(([, side], branch) => {
      const layers = [];
      let before = channels;
      strides.forEach((stride, k) => {
        const cells = side * side;
        const at = (channel, cell) => (k ? cell * kernels + channel : channel * cells + cell);
        const name = `convolutions.${pooling ? `${branch}.` : ""}${2 * k}`;
        const layer = new Convolution(name, before, side, recipe, stride, how, at);
        layers.push(layer, new LeakyRelu(leak));
        [side, before] = [layer.width, kernels];
      });
      layers[0].linear.first = true;
      const places = side * side; // those of a kernel follow one another
      const turn = (_, k) => (k % places) * kernels + Math.floor(k / places);
      const turned = Array.from({ length: kernels * places }, turn);
      layers.push(new Gather(turned, turned.length, how));
      const from = inputs - 1;
      inputs += turned.length;
      return { layers, from, slopes: zeros(how.batch * turned.length), length: turned.length };
    });
    Object.assign(this, { inputs, head: [], features: zeros(how.batch * inputs), steps: 0 });
    let [units, number] = [inputs, 0];
    for (const next of hidden) {
      this.head.push(new Linear(`head.${number++}`, units, next, how));
      if (layer_norm) this.head.push(new LayerNorm(`head.${number++}`, next, how));
      this.head.push(new LeakyRelu(leak));
      [units, number] = [next, number + 1];
    }
    this.head.push(new Linear(`head.${number}`, units, ACTIONS.length, how));
    const layers = [...this.branches.flatMap((branch) => branch.layers), ...this.head];
    this.weights = layers.flatMap((layer) => layer.weights);
  }

  /**
   * @param {ArrayLike<number>[]} views (n, channels, side, side) for each of `viewsOf`
   * @param {ArrayLike<number>} times (n,)
   * @returns {Float64Array} (n, 6), the same array each time
   */
  forward(views, times, n) {
    const { features, inputs } = this;
    this.branches.forEach(({ layers, from, length }, k) => {
      const found = layers.reduce((x, layer) => layer.forward(x, n), views[k]);
      for (let row = 0; row < n; row++)
        features.set(found.subarray(row * length, (row + 1) * length), row * inputs + from);
    });
    for (let row = 0; row < n; row++) features[(row + 1) * inputs - 1] = times[row];
    return this.head.reduce((x, layer) => layer.forward(x, n), features);
  }

  /** The gradients of what has these slopes, (n, 6), in the last Q-values. */
  backward(slopes, n) {
    const { inputs } = this;
    const all = this.head.reduceRight((x, layer) => layer.backward(x, n), slopes);
    for (const { layers, from, length, slopes: own } of this.branches) {
      for (let row = 0; row < n; row++) {
        const begin = row * inputs + from;
        own.set(all.subarray(begin, begin + length), row * length);
      }
      layers.reduceRight((x, layer) => layer.backward(x, n), own);
    }
  }

  /** A step of Adam down the gradients, with the recipe's ε of 1e-7. */
  descend(rate, amsgrad) {
    this.steps += 1;
    const step = rate / (1 - 0.9 ** this.steps);
    const unbiased = 1 / Math.sqrt(1 - 0.999 ** this.steps);
    for (const { values, gradient, moment, square, largest } of this.weights) {
      for (let k = 0; k < values.length; k++) {
        const slope = gradient[k];
        moment[k] += 0.1 * (slope - moment[k]);
        square[k] += 0.001 * (slope * slope - square[k]);
        if (square[k] > largest[k]) largest[k] = square[k];
        const size = amsgrad ? largest[k] : square[k];
        values[k] -= (step * moment[k]) / (Math.sqrt(size) * unbiased + 1e-7);
      }
    }
  }

  /** θ ← (1 − τ) θ + τ θ of the other; a τ of 1 copies it. */
  follow(other, tau) {
    this.weights.forEach(({ values }, number) => {
      const goals = other.weights[number].values;
      for (let k = 0; k < values.length; k++) values[k] += tau * (goals[k] - values[k]);
    });
  }

  /** By name, as in a checkpoint. */
  get tensors() {
    return Object.fromEntries(this.weights.map(({ name, ...tensor }) => [name, tensor]));
  }

  set tensors(tensors) {
    for (const { name, values } of this.weights) values.set(tensors[name].values);
  }
}

/** What a network sees of a map, with the sides: all, or, pooled, all and the cells around the UAV. */
export function viewsOf(map, width, recipe) {
  const { pooling, local_size: most } = recipe;
  if (!pooling) return [wholeFrame(map, width, recipe, 1)];
  const local = Math.min(most, width);
  const all = averagePool(...wholeFrame(map, width, recipe, pooling), pooling);
  return [all, wholeFrame(middle(map, width, local), local, recipe, 1)];
}

/** Cells as outside the city, south and east, so that no layer leaves any out; network.py. */
function wholeFrame(map, width, { kernel_size, strides }, pooling) {
  const window = strides.reduceRight((cells, stride) => (cells - 1) * stride + kernel_size, 1);
  const step = strides.reduce((product, stride) => product * stride, 1);
  const further = Math.ceil((Math.ceil(width / pooling) - window) / step);
  const side = pooling * (window + Math.max(further, 0) * step);
  if (side === width) return [map, side];
  const framed = new Float32Array((map.length / width ** 2) * side ** 2);
  framed.fill(1, NO_FLY_LAYER * side ** 2, (NO_FLY_LAYER + 1) * side ** 2);
  for (let row = 0; row < map.length / width; row++) {
    const to = Math.floor(row / width) * side ** 2 + (row % width) * side;
    framed.set(map.subarray(row * width, (row + 1) * width), to);
  }
  return [framed, side];
}

/** The map averaged over cells of g×g. */
function averagePool(map, width, pooling) {
  const [out, channels] = [Math.floor(width / pooling), map.length / width ** 2];
  const found = new Float32Array(channels * out ** 2);
  found.forEach((_, place) => {
    const [line, col] = [Math.floor(place / out), place % out];
    const [channel, row] = [Math.floor(line / out), line % out];
    let total = 0;
    for (let r = 0; r < pooling; r++) {
      const begin = channel * width ** 2 + (row * pooling + r) * width + col * pooling;
      for (let c = 0; c < pooling; c++) total += map[begin + c];
    }
    found[place] = total / pooling ** 2;
  });
  return [found, out];
}

/** The l×l cells around the UAV. */
function middle(map, width, local) {
  const [margin, channels] = [(width - local) / 2, map.length / width ** 2];
  const found = new Float32Array(channels * local ** 2);
  for (let line = 0; line < channels * local; line++) {
    const begin = (Math.floor(line / local) * width + margin + (line % local)) * width + margin;
    found.set(map.subarray(begin, begin + local), line * local);
  }
  return found;
}
