"""Exercises of notebook 5, a network by hand."""

import numpy as np

from uavdh_lite.course.checks.exercise import exercise
from uavdh_lite.streams import Use, stream


def examples(count, rate, steps):
    """Inputs and outputs of so many examples, not quite on a line, and the other arguments."""
    generator = stream(Use.EXERCISE, count)
    x = generator.uniform(-1, 2, count).round(2)
    return x, (3 * x - 1 + generator.normal(0, 0.3, count)).round(2), rate, steps


@exercise(
    "5.1 · A neuron that learns (3 points, 15 minutes)",
    rules={
        "w and b begin at 0, and without a step they stay there.": [(3, 0.1, 0)],
        "The slope of the loss is the mean over all examples of 2 · error · x for w, and of "
        "2 · error for b, with error = w·x + b − y. Compute both slopes first; then move w and b "
        "*down*, each by the rate times its slope.": [(1, 0.1, 1), (2, 0.1, 1)],
        "Every step begins where the last one ended, and moves w and b at the same time, with the "
        "errors from before the step, even if the loss grows.": [
            (2, 0.1, 2),
            (5, 0.05, 3),
            (4, 2.0, 3),
            (6, 0.002, 2000),
        ],
    },
    mistakes={
        "That is one step too few.": (
            lambda x, y, rate, steps: fitted_line.solution(x, y, rate, max(steps - 1, 0))
        ),
        "Take the mean over the examples, not the sum.": (
            lambda x, y, rate, steps: fitted_line.solution(x, y, rate * len(x), steps)
        ),
        "The 2 from the derivative of the square is missing.": (
            lambda x, y, rate, steps: fitted_line.solution(x, y, rate / 2, steps)
        ),
    },
    case=examples,
)
def fitted_line(x, y, rate, steps):
    """`fit(x, y, rate, steps)`: w and b of a neuron after gradient descent from 0."""
    w = b = 0.0
    for _ in range(steps):
        error = w * x + b - y
        w, b = w - rate * 2 * np.mean(error * x), b - rate * 2 * np.mean(error)
    return w, b


def windows(layer, kernel, bias, steps=1):
    seen = np.lib.stride_tricks.sliding_window_view(layer, kernel.shape)[::steps, ::steps]
    return (seen * kernel).sum((2, 3)) + bias


def drawn(rows, cols, height, width, bias=0.0):
    generator = stream(Use.EXERCISE, 10 * rows + cols)
    layer = generator.normal(0, 1, (rows, cols)).round(1)
    return layer, generator.normal(0, 1, (height, width)).round(1), bias


@exercise(
    "5.2 · A kernel moves over a map (2 points, 12 minutes)",
    rules={
        "The window at (i, j) is as large as the kernel. The value is the sum of window times "
        "kernel, cell by cell. The kernel must lie wholly inside, so there are rows − k + 1 places "
        "for it from top to bottom.": [
            (np.ones((2, 2)), np.ones((1, 1)), 0.0),
            (np.ones((3, 3)), np.ones((2, 2)), 0.0),
            (np.arange(16.0).reshape(4, 4), np.array([[1.0, 1, 1], [1, 5, 1], [1, 1, 1]]), 0.0),
        ],
        "The result is a map of floats, np.zeros(shape), whatever the layer holds.": [
            (np.array([[1, 2], [3, 4]]), np.array([[0.5]]), 0)
        ],
        "The kernel is applied as it is: neither turned nor mirrored.": [
            (np.arange(9.0).reshape(3, 3), np.array(kernel), 0.0)
            for kernel in ([[0.0, 1.0], [2.0, 0.0]], [[0.0, 0.0], [1.0, 3.0]])
        ],
        "The bias is added once at every place, and then comes ReLU: what is below 0 becomes 0.": [
            (np.ones((3, 3)), np.ones((2, 2)), 1.5),
            (np.ones((2, 2)), np.ones((1, 1)), -2.0),
            drawn(5, 5, 3, 3, 0.4),
        ],
        "Layer and kernel need not be square.": [
            drawn(3, 6, 2, 2, 0.3),
            drawn(6, 4, 2, 3, 0.9),
            drawn(4, 7, 4, 1, -0.2),
        ],
    },
    mistakes={
        "ReLU is missing: what is below 0 becomes 0.": windows,
        "ReLU comes after the bias, not before it.": (
            lambda layer, kernel, bias: np.maximum(windows(layer, kernel, 0), 0) + bias
        ),
        "A kernel moves by one cell at a time, not by its own size.": (
            lambda layer, kernel, bias: np.maximum(windows(layer, kernel, bias, len(kernel)), 0)
        ),
    },
)
def convolve(layer, kernel, bias):
    """`convolve(layer, kernel, bias)`: one kernel's map after ReLU, without padding."""
    return np.maximum(windows(layer, kernel, bias), 0)


HIDDEN = (9,), (30, 8), (8, 9, 10, 7)


@exercise(
    "5.3 · How many weights? (3 points, 15 minutes)",
    rules={
        "The map has 2M − 1 cells on a side; without padding, a kernel fits in side − kernel_size "
        "+ 1 places along it. A kernel has a weight for each cell of its square in each layer that "
        "it sees, and a neuron has one for each number that it is given. Each kernel and each "
        "neuron, including the 6 of the output, has a bias of its own. The first fully connected "
        "layer reads kernels · side² numbers, and the flying time.": [
            (2, 2, 3, 2, (1,), (4,)),
            (1, 2, 1, 1, (1,), (1,)),
            (3, 3, 2, 3, (1,), (5,)),
        ],
        "(side − kernel_size) // stride + 1 cells on a side are left: kernels lie wholly inside. "
        "Divide side − kernel_size by the stride and round down; only then add the 1.": [
            (2, 3, 4, 2, (2,), (6,)),
            (2, 3, 4, 2, (3,), (6,)),
            (3, 12, 9, 3, (3,), (20,)),
        ],
        "A second convolution sees as many layers as the first has kernels, and has its own "
        "stride, and so on, for any number of convolutions and hidden layers. The recipe "
        "`paper` has 2,308,854.": [
            (5, 16, 16, 5, (1, 1), (256, 256, 256)),
            (4, 13, 8, 4, (3, 2), (64, 32)),
        ]
        + [(4, 16, 9, 3, s, h) for s in ((1,), (2, 1), (1, 2, 2)) for h in HIDDEN],
    },
    mistakes={
        "The flying time is missing: the first fully connected layer reads it, too.": (
            lambda *case: network_weights.solution(*case, time=0)
        )
    },
)
def network_weights(layers, size, kernels, kernel_size, strides, hidden, time=1):
    """`weights(layers, size, kernels, kernel_size, strides, hidden)`: of the centred Q-network."""
    side, total = 2 * size - 1, 0
    for stride in strides:
        total += kernels * (layers * kernel_size**2 + 1)
        side, layers = (side - kernel_size) // stride + 1, kernels
    width = kernels * side**2 + time
    for neurons in (*hidden, 6):
        total += neurons * (width + 1)
        width = neurons
    return float(total)
