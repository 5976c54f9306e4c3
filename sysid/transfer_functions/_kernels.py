"""Hot loop of the responses: discrete state recursions of many channels at once.

Arrays are copied element by element: numba takes seconds to compile the error text of one slice assignment.
"""

import math

import numpy as np

from core.compiled import njit
from core.kernel_types import Int64s, Matrix, Stack


@njit(cache=True, nogil=True, fastmath={"contract"})
def recur(
    transition: Stack, across: Stack, from_now: Matrix, from_next: Matrix, start: Matrix, inputs: Matrix, driving: Stack
) -> Stack:
    """Run ``x[k+1] = F x[k] + H w[k] + g0 u[k] + g1 u[k+1]`` for every lane and keep all states.

    Lanes (channels) are the last axis, so that the inner loops are vector instructions.
    """
    samples, lanes = inputs.shape
    order = transition.shape[0]
    states = np.empty((samples, order, lanes))
    for i in range(order):
        for lane in range(lanes):
            states[0, i, lane] = start[i, lane]
    for k in range(samples - 1):
        for i in range(order):
            for lane in range(lanes):
                states[k + 1, i, lane] = from_now[i, lane] * inputs[k, lane] + from_next[i, lane] * inputs[k + 1, lane]
            for j in range(across.shape[1]):
                for lane in range(lanes):
                    states[k + 1, i, lane] += across[i, j, lane] * driving[k, j, lane]
            for j in range(order):
                for lane in range(lanes):
                    states[k + 1, i, lane] += transition[i, j, lane] * states[k, j, lane]
    return states


@njit(cache=True, nogil=True, fastmath={"contract"})
def recur_few(
    transposed: Stack, across: Stack, from_now: Matrix, from_next: Matrix, start: Matrix, inputs: Matrix, driving: Stack
) -> Stack:
    """Do the same as `recur` for few lanes, one after the other, with the states as vector lanes."""
    samples, lanes = inputs.shape
    order = transposed.shape[1]
    states = np.empty((samples, order, lanes))
    now, after = np.empty(order), np.empty(order)
    for lane in range(lanes):
        for i in range(order):
            now[i] = start[lane, i]
            states[0, i, lane] = now[i]
        for k in range(samples - 1):
            here, there = inputs[k, lane], inputs[k + 1, lane]
            for i in range(order):
                after[i] = from_now[lane, i] * here + from_next[lane, i] * there
            for j in range(across.shape[1]):
                value = driving[k, j, lane]
                for i in range(order):
                    after[i] += across[lane, j, i] * value
            for j in range(order):
                value = now[j]
                for i in range(order):
                    after[i] += transposed[lane, j, i] * value
            for i in range(order):
                now[i] = after[i]
                states[k + 1, i, lane] = after[i]
    return states


@njit(cache=True, nogil=True)
def multiply_out(theta: Matrix, orders: Int64s) -> tuple[Matrix, Stack]:
    """Multiply sections out and differentiate the product; see `sysid.transfer_functions.problem.denominators`."""
    groups, most = theta.shape
    a, slope, rest = np.zeros((groups, most)), np.zeros((groups, most, most)), np.empty(most + 1)
    for g in range(groups):
        n = orders[g]
        sections = (n + 1) // 2
        # The product without each section in turn, which its derivative multiplies; at last the whole one.
        for without in range(sections + 1):
            for k in range(1, n + 1):
                rest[k] = 0.0
            rest[0], degree = 1.0, 0
            for i in range(sections):
                if i == without:
                    continue
                w = math.exp(theta[g, 2 * i])
                if 2 * i + 1 < n:
                    damping = 2.0 * w * math.exp(theta[g, 2 * i + 1])
                    for k in range(degree + 2, 1, -1):
                        rest[k] = w * w * rest[k] + damping * rest[k - 1] + rest[k - 2]
                    rest[1] = w * w * rest[1] + damping * rest[0]
                    rest[0] *= w * w
                    degree += 2
                else:
                    for k in range(degree + 1, 0, -1):
                        rest[k] = w * rest[k] + rest[k - 1]
                    rest[0] *= w
                    degree += 1
            if without == sections:
                for k in range(n):
                    a[g, k] = rest[k]
                break
            first = 2 * without
            w = math.exp(theta[g, first])
            for k in range(degree + 1):
                if first + 1 < n:
                    damping = 2.0 * w * math.exp(theta[g, first + 1])
                    slope[g, k, first] += 2.0 * w * w * rest[k]
                    slope[g, k + 1, first] += damping * rest[k]
                    slope[g, k + 1, first + 1] += damping * rest[k]
                else:
                    slope[g, k, first] = w * rest[k]
    return a, slope


def compile_kernels() -> None:
    """Compile what is not yet compiled, so that a time limit is not spent on it."""
    lane, pair, cube = np.zeros((1, 1)), np.zeros((2, 1)), np.zeros((1, 1, 1))
    drive = np.zeros((2, 1, 1))
    recur(cube, cube, lane, lane, lane, pair, drive)
    recur_few(cube, cube, lane, lane, lane, pair, drive)
    multiply_out(lane, np.ones(1, np.int64))
