"""The spline of a command, whose derivatives a host with the complete path gives to a unit."""


def spline(x, h):
    """First, second and third derivatives at the begin of every interval of the C2 cubic spline
    whose end slopes are those of the cubics through the first and the last four samples."""
    n = len(x)
    begin = (-11 * x[0] + 18 * x[1] - 9 * x[2] + 2 * x[3]) / (6 * h)
    end = (11 * x[-1] - 18 * x[-2] + 9 * x[-3] - 2 * x[-4]) / (6 * h)
    # Second derivatives by the tridiagonal system of the textbooks.
    lower, diagonal, upper, right = [0.0] * n, [0.0] * n, [0.0] * n, [0.0] * n
    diagonal[0], upper[0] = 2.0, 1.0
    right[0] = 6 * ((x[1] - x[0]) / h - begin) / h
    for i in range(1, n - 1):
        lower[i], diagonal[i], upper[i] = 1.0, 4.0, 1.0
        right[i] = 6 * (x[i + 1] - 2 * x[i] + x[i - 1]) / h ** 2
    lower[-1], diagonal[-1] = 1.0, 2.0
    right[-1] = 6 * (end - (x[-1] - x[-2]) / h) / h
    for i in range(1, n):
        factor = lower[i] / diagonal[i - 1]
        diagonal[i] -= factor * upper[i - 1]
        right[i] -= factor * right[i - 1]
    second = [0.0] * n
    second[-1] = right[-1] / diagonal[-1]
    for i in range(n - 2, -1, -1):
        second[i] = (right[i] - upper[i] * second[i + 1]) / diagonal[i]
    first = [(x[i + 1] - x[i]) / h - h * (2 * second[i] + second[i + 1]) / 6 for i in range(n - 1)]
    third = [(second[i + 1] - second[i]) / h for i in range(n - 1)]
    return first, second, third
