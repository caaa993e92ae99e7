"""Wrong answers to the exercises of notebook 4, and what the message must say of each."""

import numpy as np


def cell(change, check=True, last=0, first=0):
    def answer(place, uav, size):
        found = tuple(change(p, u, size) for p, u in zip(place, uav, strict=True))
        inside = all(first <= k < size + last for k in found)
        return found if inside or not check else None

    return answer


def back(p, u, m):
    return p + u - m + 1


def forgets_return(place, uav, size):
    cell(back)(place, uav, size)


def centred(shift=0, sign=1, fill=None, dtype=None):
    """Write the layer into a map cell by cell."""

    def answer(layer, uav, outside):
        size = len(layer)
        value = outside if fill is None else fill
        result = np.full((2 * size - 1, 2 * size - 1), value, dtype or float)
        for row, col in np.ndindex(layer.shape):
            place = [
                size - 1 + sign * (one - u) + shift for one, u in zip((row, col), uav, strict=True)
            ]
            if all(0 <= one < 2 * size - 1 for one in place):
                result[tuple(place)] = layer[row, col]
        return result

    return answer


def opposite_shift(layer, uav, outside):
    size = len(layer)
    result = np.full((2 * size - 1, 2 * size - 1), outside, float)
    result[uav[0] : uav[0] + size, uav[1] : uav[1] + size] = layer
    return result


def swapped(layer, uav, outside):
    return centred()(layer, uav[::-1], outside)


def of_the_layers_type(layer, uav, outside):
    return centred(dtype=layer.dtype)(layer, uav, outside)


def slice_too_late(layer, uav, outside):
    size = len(layer)
    result = np.full((2 * size - 1, 2 * size - 1), outside, float)
    result[size - uav[0] : 2 * size - uav[0], size - uav[1] : 2 * size - uav[1]] = layer
    return result


def wrapping(layer, uav, outside):
    size = len(layer)
    result = np.full((2 * size - 1, 2 * size - 1), outside, layer.dtype)
    for row, col in np.ndindex(result.shape):
        one, other = row + uav[0] - size + 1, col + uav[1] - size + 1
        result[row, col] = layer[one % size, other % size]
    return result


def erases(layer, uav, outside):
    result = centred()(layer, uav, outside)
    layer[:] = 0
    return result


def count(
    bias=1,
    time=1,
    outputs=6,
    whole_map=True,
    rest=True,
    layers_again=False,
    pad=False,
    up=False,
    flat=False,
    layer_bias=False,
    last_bias=1,
):
    def answer(layers, size, kernels, kernel_size, strides, hidden):
        side = 2 * size - 1 if whole_map else size
        channels, total = layers, 0
        for stride in strides:
            total += kernels * channels * kernel_size**2 + (1 if layer_bias else kernels * bias)
            fits = side if pad else side - kernel_size + 1
            side = -(-(fits + up * (stride - 1)) // stride) if rest else fits // stride
            channels = layers if layers_again else kernels
        inputs = (1 if flat else kernels) * side * side + time
        for neurons in hidden:
            total += inputs * neurons + (1 if layer_bias else neurons * bias)
            inputs = neurons
        return total + inputs * outputs + (1 if layer_bias else outputs * bias * last_bias)

    return answer


MISTAKES = {
    "city_cell": [
        (cell(back, check=False), "outside the city: None"),
        (cell(lambda p, u, m: p - u + m - 1), "the other direction"),
        (cell(lambda p, u, m: p + u - m), "off by one"),
        (cell(lambda p, u, m: u - p + m - 1), "wrong way"),
        (cell(back, last=1), "or M or more"),
        (cell(back, first=1), "Row 0 and column 0"),
        (cell(back, last=-1), "so are row M − 1"),
        (forgets_return, "is a `return` missing|gives None"),
        (lambda place, uav, size: -1, "two numbers are expected"),
    ],
    "centre": [
        (opposite_shift, "wrong way"),
        (centred(shift=1), r"in the middle, at \(M − 1, M − 1\)"),
        (centred(shift=-1), r"in the middle, at \(M − 1, M − 1\)"),
        (centred(fill=0), "the map is `outside`"),
        (swapped, "Rows and columns are swapped"),
        (of_the_layers_type, "Make a map of floats"),
        (
            slice_too_late,
            "the UAV's in the middle",
        ),
        (centred(dtype=int), "Make a map of floats"),
        (wrapping, r"outside the city\.$"),
        (erases, "changes what it is given"),
        (centred(sign=-1), "the place .* of the map "),
        (lambda *case: centred()(*case).tolist(), "an array is expected, not a list"),
        (lambda layer, uav, outside: np.pad(layer, len(layer) - 1), "has the shape .*2M − 1"),
    ],
    "network_weights": [
        (count(bias=0), "Each kernel and each neuron"),
        (count(time=0), "flying time is missing"),
        (count(outputs=0), "the output has 6 values"),
        (count(whole_map=False), "2M − 1 cells a side, neither M"),
        (count(rest=False), "round down, and add the 1 after that"),
        (count(layers_again=True), "as many layers as the first has kernels"),
        (count(pad=True), "without padding a kernel fits"),
        (count(up=True), "round down, and add the 1 after that"),
        (count(flat=True), "list has the numbers of all kernels"),
        (count(layer_bias=True), "has a bias of its own"),
        (count(last_bias=0), "those of the output too"),
        (lambda *case: 2_308_854, "gives 2308854, expected"),
    ],
}
