// A Q-network that learns: network.py with its gradients, and the optimiser. tests/labs/test_network.py
// compares both with PyTorch's.
//
// A batch has n rows. A map of W×W cells is written cell by cell, with all channels of a cell beside
// each other, and so is what the convolutions make of it. Buffers are made once.

import { ACTIONS } from "./world.js";

/** Weights of a layer, under their name in PyTorch, with their gradient and what Adam keeps of it. */
class Weights {
  constructor(name, shape, values) {
    Object.assign(this, { name, shape, values });
    this.gradient = new Float32Array(values.length);
    this.moment = new Float32Array(values.length);
    this.square = new Float32Array(values.length);
    this.largest = new Float32Array(values.length);
  }
}

/** Glorot's uniform weights. */
function glorot(generator, count, inputs, outputs) {
  const most = Math.sqrt(6 / (inputs + outputs));
  return Float32Array.from({ length: count }, () => generator.uniform(-most, most));
}

/**
 * c = a · bᵀ, of which a has `rows` and b `cols` rows of `inner` numbers. Two rows by four are summed
 * at once, so that what is read serves several sums; where rows end, the last one comes again. Each
 * sum is a variable of its own, because engines make fast code of that alone.
 */
function product(a, b, c, rows, cols, inner) {
  for (let j = 0; j < cols; j += 4) {
    const [j1, j2, j3] = [
      Math.min(j + 1, cols - 1),
      Math.min(j + 2, cols - 1),
      Math.min(j + 3, cols - 1),
    ];
    const p = j * inner;
    const q = j1 * inner;
    const r = j2 * inner;
    const s = j3 * inner;
    for (let i = 0; i < rows; i += 2) {
      const below = Math.min(i + 1, rows - 1);
      const first = i * inner;
      const second = below * inner;
      let s0 = 0;
      let s1 = 0;
      let s2 = 0;
      let s3 = 0;
      let t0 = 0;
      let t1 = 0;
      let t2 = 0;
      let t3 = 0;
      for (let k = 0; k < inner; k++) {
        const x = a[first + k];
        const y = a[second + k];
        const w0 = b[p + k];
        const w1 = b[q + k];
        const w2 = b[r + k];
        const w3 = b[s + k];
        s0 += x * w0;
        t0 += y * w0;
        s1 += x * w1;
        t1 += y * w1;
        s2 += x * w2;
        t2 += y * w2;
        s3 += x * w3;
        t3 += y * w3;
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

/** b = aᵀ, of which a has so many rows and columns. */
function transpose(a, b, rows, cols) {
  for (let i = 0; i < rows; i++) for (let j = 0; j < cols; j++) b[j * rows + i] = a[i * cols + j];
}

class Linear {
  constructor(name, inputs, outputs, batch, generator) {
    Object.assign(this, { inputs, outputs, batch });
    const values = glorot(generator, inputs * outputs, inputs, outputs);
    this.weight = new Weights(`${name}.weight`, [outputs, inputs], values);
    this.bias = new Weights(`${name}.bias`, [outputs], new Float32Array(outputs));
    this.out = new Float32Array(batch * outputs);
    this.slopes = new Float32Array(batch * inputs);
    const sizes = { columns: inputs * batch, turned: outputs * batch, across: inputs * outputs };
    for (const [buffer, size] of Object.entries(sizes)) this[buffer] = new Float32Array(size);
  }

  get weights() {
    return [this.weight, this.bias];
  }

  forward(x, n) {
    const { inputs, outputs, out } = this;
    product(x, this.weight.values, out, n, outputs, inputs);
    for (let at = 0; at < n * outputs; at++) out[at] += this.bias.values[at % outputs];
    this.x = x;
    return out;
  }

  backward(slopes, n) {
    const { inputs, outputs, columns, turned, across } = this;
    transpose(this.x, columns, n, inputs);
    transpose(slopes, turned, n, outputs);
    transpose(this.weight.values, across, outputs, inputs);
    product(turned, columns, this.weight.gradient, outputs, inputs, n);
    this.bias.gradient.fill(0);
    for (let at = 0; at < n * outputs; at++) this.bias.gradient[at % outputs] += slopes[at];
    product(slopes, across, this.slopes, n, inputs, outputs);
    return this.slopes;
  }
}

/** Kernels over each place of a map, no padding. Inputs of 0 cost nothing: most of a map, half after a ReLU. */
class Convolution {
  constructor(name, channels, width, kernels, side, stride, batch, generator) {
    Object.assign(this, { channels, cells: width ** 2, kernels });
    this.width = Math.floor((width - side) / stride) + 1;
    this.places = this.width ** 2;
    const area = side ** 2;
    const values = glorot(generator, kernels * channels * area, channels * area, kernels * area);
    this.weight = new Weights(`${name}.weight`, [kernels, channels, side, side], values);
    this.bias = new Weights(`${name}.bias`, [kernels], new Float32Array(kernels));
    this.out = new Float32Array(batch * this.places * kernels);
    this.slopes = new Float32Array(batch * this.cells * channels);
    // For each cell, the places whose kernel it is under, and where in the kernel
    this.begin = new Int32Array(this.cells + 1);
    const under = [];
    for (let cell = 0; cell < this.cells; cell++) {
      const [row, col] = [Math.floor(cell / width), cell % width];
      for (let place = 0; place < this.places; place++) {
        const down = row - stride * Math.floor(place / this.width);
        const right = col - stride * (place % this.width);
        const inside = Math.min(down, right) >= 0 && Math.max(down, right) < side;
        if (inside) under.push(place * kernels, (down * side + right) * channels * kernels);
      }
      this.begin[cell + 1] = under.length;
    }
    this.under = Int32Array.from(under);
  }

  get weights() {
    return [this.weight, this.bias];
  }

  forward(x, n) {
    const { channels, cells, kernels, places, begin, under, out } = this;
    const weight = this.weight.values;
    for (let at = 0; at < n * places * kernels; at++) out[at] = this.bias.values[at % kernels];
    for (let row = 0; row < n; row++) {
      for (let cell = 0; cell < cells; cell++) {
        const there = (row * cells + cell) * channels;
        for (let channel = 0; channel < channels; channel++) {
          const value = x[there + channel];
          if (value === 0) continue;
          for (let at = begin[cell]; at < begin[cell + 1]; at += 2) {
            const to = row * places * kernels + under[at];
            const from = under[at + 1] + channel * kernels;
            for (let k = 0; k < kernels; k += 4) {
              out[to + k] += value * weight[from + k];
              out[to + k + 1] += value * weight[from + k + 1];
              out[to + k + 2] += value * weight[from + k + 2];
              out[to + k + 3] += value * weight[from + k + 3];
            }
          }
        }
      }
    }
    this.x = x;
    return out;
  }

  /** The slopes of inputs of 0 stay 0: they come from a ReLU, or nothing is before them. */
  backward(slopes, n) {
    const { channels, cells, kernels, places, begin, under, x } = this;
    const [weight, gradient] = [this.weight.values, this.weight.gradient.fill(0)];
    this.bias.gradient.fill(0);
    for (let at = 0; at < n * places * kernels; at++)
      this.bias.gradient[at % kernels] += slopes[at];
    for (let row = 0; row < n; row++) {
      for (let cell = 0; cell < cells; cell++) {
        const there = (row * cells + cell) * channels;
        for (let channel = 0; channel < channels; channel++) {
          const value = x[there + channel];
          this.slopes[there + channel] = 0;
          if (value === 0) continue;
          let slope = 0;
          for (let at = begin[cell]; at < begin[cell + 1]; at += 2) {
            const to = row * places * kernels + under[at];
            const from = under[at + 1] + channel * kernels;
            for (let k = 0; k < kernels; k += 4) {
              const g0 = slopes[to + k];
              const g1 = slopes[to + k + 1];
              const g2 = slopes[to + k + 2];
              const g3 = slopes[to + k + 3];
              gradient[from + k] += value * g0;
              gradient[from + k + 1] += value * g1;
              gradient[from + k + 2] += value * g2;
              gradient[from + k + 3] += value * g3;
              slope +=
                weight[from + k] * g0 +
                weight[from + k + 1] * g1 +
                weight[from + k + 2] * g2 +
                weight[from + k + 3] * g3;
            }
          }
          this.slopes[there + channel] = slope;
        }
      }
    }
    return this.slopes;
  }
}

class LayerNorm {
  constructor(name, units, batch) {
    Object.assign(this, { units });
    this.weight = new Weights(`${name}.weight`, [units], new Float32Array(units).fill(1));
    this.bias = new Weights(`${name}.bias`, [units], new Float32Array(units));
    for (const buffer of ["out", "normal", "slopes"])
      this[buffer] = new Float32Array(batch * units);
    this.scale = new Float32Array(batch);
  }

  get weights() {
    return [this.weight, this.bias];
  }

  forward(x, n) {
    const { units, out, normal, scale } = this;
    for (let row = 0; row < n; row++) {
      const there = row * units;
      let [mean, variance] = [0, 0];
      for (let k = 0; k < units; k++) mean += x[there + k] / units;
      for (let k = 0; k < units; k++) variance += (x[there + k] - mean) ** 2 / units;
      scale[row] = 1 / Math.sqrt(variance + 1e-5);
      for (let k = 0; k < units; k++) {
        normal[there + k] = (x[there + k] - mean) * scale[row];
        out[there + k] = normal[there + k] * this.weight.values[k] + this.bias.values[k];
      }
    }
    return out;
  }

  backward(slopes, n) {
    const { units, normal, scale } = this;
    const [weight, gradient] = [this.weight.values, this.weight.gradient.fill(0)];
    const bias = this.bias.gradient.fill(0);
    for (let row = 0; row < n; row++) {
      const there = row * units;
      let [mean, along] = [0, 0];
      for (let k = there; k < there + units; k++) {
        bias[k - there] += slopes[k];
        gradient[k - there] += slopes[k] * normal[k];
        mean += (slopes[k] * weight[k - there]) / units;
        along += (slopes[k] * weight[k - there] * normal[k]) / units;
      }
      for (let k = there; k < there + units; k++)
        this.slopes[k] = scale[row] * (slopes[k] * weight[k - there] - mean - normal[k] * along);
    }
    return this.slopes;
  }
}

/** In place. */
class Relu {
  weights = [];

  forward(x, n) {
    const count = n * (x.length / this.batch);
    for (let at = 0; at < count; at++) if (x[at] < 0) x[at] = 0;
    this.x = x;
    return x;
  }

  backward(slopes, n) {
    const count = n * (slopes.length / this.batch);
    for (let at = 0; at < count; at++) if (this.x[at] === 0) slopes[at] = 0;
    return slopes;
  }

  constructor(batch) {
    this.batch = batch;
  }
}

/** Puts the flying time behind the features. */
class WithTime {
  weights = [];

  constructor(features, batch) {
    Object.assign(this, { features, times: null });
    this.out = new Float32Array(batch * (features + 1));
    this.slopes = new Float32Array(batch * features);
  }

  forward(x, n) {
    const { features, out } = this;
    for (let row = 0; row < n; row++) {
      for (let k = 0; k < features; k++) out[row * (features + 1) + k] = x[row * features + k];
      out[row * (features + 1) + features] = this.times[row];
    }
    return out;
  }

  backward(slopes, n) {
    const { features } = this;
    for (let row = 0; row < n; row++)
      for (let k = 0; k < features; k++)
        this.slopes[row * features + k] = slopes[row * (features + 1) + k];
    return this.slopes;
  }
}

/** The side of the map with the cells that are added to the south and east, so that no row or column is left out. */
export function frameSide(width, side, strides) {
  let window = 1; // cells on a side that one place after the last convolution sees
  for (const stride of strides.toReversed()) window = (window - 1) * stride + side;
  const step = strides.reduce((product, stride) => product * stride, 1);
  return window + Math.max(Math.ceil((width - window) / step), 0) * step;
}

/** Q-values of all actions; see network.py. */
export class QNetwork {
  /**
   * @param {object} recipe its layers
   * @param {number} channels of the map
   * @param {number} side of the map, cells
   * @param {number} batch the most rows at a time
   * @param {import("./world.js").Portable} generator of the first weights
   */
  constructor(
    { kernels, kernel_size, strides, hidden, layer_norm },
    channels,
    side,
    batch,
    generator,
  ) {
    const layers = (this.layers = []);
    let width = side;
    strides.forEach((stride, k) => {
      const before = k ? kernels : channels;
      layers.push(
        new Convolution(
          `convolutions.${2 * k}`,
          before,
          width,
          kernels,
          kernel_size,
          stride,
          batch,
          generator,
        ),
      );
      layers.push(new Relu(batch));
      ({ width } = layers.at(-2));
    });
    this.flat = [kernels, width ** 2];
    layers.push((this.time = new WithTime(kernels * width ** 2, batch)));
    let [inputs, number] = [kernels * width ** 2 + 1, 0];
    for (const units of hidden) {
      layers.push(new Linear(`head.${number++}`, inputs, units, batch, generator));
      if (layer_norm) layers.push(new LayerNorm(`head.${number++}`, units, batch));
      layers.push(new Relu(batch));
      [inputs, number] = [units, number + 1];
    }
    layers.push(new Linear(`head.${number}`, inputs, ACTIONS.length, batch, generator));
    this.weights = layers.flatMap((layer) => layer.weights);
    this.steps = 0; // of Adam
  }

  /** @returns {Float32Array} (n, 6), the same array each time */
  forward(maps, times, n) {
    this.time.times = times;
    return this.layers.reduce((x, layer) => layer.forward(x, n), maps);
  }

  /** The gradients of what has these slopes in the last Q-values. @param {Float32Array} slopes (n, 6) */
  backward(slopes, n) {
    this.layers.reduceRight((x, layer) => layer.backward(x, n), slopes);
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

  /** All weights in the order of PyTorch's. @returns {Object<string, {shape: number[], values: Float32Array}>} */
  get tensors() {
    return this.asTensors("values");
  }

  /** @param {string} part of the weights: `values`, or their `gradient` */
  asTensors(part) {
    const sorted = ({ name, shape, [part]: own }) => {
      const values = Float32Array.from(this.order(name, shape), (place) => own[place]);
      return [name, { shape, values }];
    };
    return Object.fromEntries(this.weights.map(sorted));
  }

  set tensors(tensors) {
    for (const { name, shape, values } of this.weights)
      this.order(name, shape).forEach((own, place) => (values[own] = tensors[name].values[place]));
  }

  /** For each place of a tensor in PyTorch's order, that in ours: there, all of a channel stand beside each other. */
  order(name, shape) {
    const [kernels, channels, side] = shape;
    const [features, places] = this.flat;
    const turned = (place, inner) => (place % inner) * features + Math.floor(place / inner);
    const all = [...Array(shape.reduce((count, length) => count * length, 1)).keys()];
    if (shape.length === 4) {
      const area = side ** 2;
      return all.map((at) => {
        const [kernel, channel, tap] = [
          Math.floor(at / (channels * area)),
          Math.floor(at / area) % channels,
          at % area,
        ];
        return (tap * channels + channel) * kernels + kernel;
      });
    }
    if (name !== "head.0.weight") return all;
    const inputs = features * places + 1;
    return all.map(
      (at) =>
        at -
        (at % inputs) +
        (at % inputs === inputs - 1 ? inputs - 1 : turned(at % inputs, places)),
    );
  }
}
