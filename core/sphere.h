// Sets of directions on the sphere: layouts for stages and virtual lights, neighbours, spacing.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/direction.h"

namespace lightstage::core {

// n >= 1 directions of the spherical Fibonacci lattice (Gonzalez 2010, "Measurement of areas on a sphere
// using Fibonacci and latitude-longitude lattices"), nearly uniform, from +y down to -y. Throws UsageError
// for n == 0.
std::vector<Direction> fibonacci_directions(std::size_t n);

// The vertices of an icosahedron whose faces are split into frequency^2 triangles and projected to the sphere
// (10 frequency^2 + 2 of them), for the smallest frequency that gives at least n; all of them are returned.
std::vector<Direction> geodesic_directions(std::size_t at_least_n);

// n directions uniformly at random on the whole sphere, the same for a seed on every machine.
std::vector<Direction> random_directions(std::size_t n, std::uint64_t seed);

// Indices of the k directions nearest to the query (all of them if fewer), nearest first, ties by lower
// index. O(n + k log k).
std::vector<std::size_t> nearest_indices(std::span<const Direction> directions, const Direction& query, std::size_t k);

// The indices 0 .. n - 1 in an order in which directions that follow each other are near each other: along a Hilbert curve over the octahedral map
// of the sphere (Hilbert 1891; Engelhardt and Dachsbacher 2008, "Octahedron environment maps"). For work whose caches hold what neighbours share.
// O(n log n).
std::vector<std::size_t> neighbouring_order(std::span<const Direction> directions);

// Median over the directions of the angle to their nearest other one, in radians. Duplicates (closer than
// 1e-6) do not count as neighbours. pi for fewer than two distinct directions. O(n^2).
double median_spacing_radians(std::span<const Direction> directions);

// The solid angle nearest to each direction (its Voronoi cell on the sphere) in steradians, by counting
// `samples` Fibonacci points: sums to 4 pi, relative error of a cell about 1/sqrt(samples/n). Duplicates
// share their cell. O(samples n).
std::vector<double> voronoi_solid_angles(std::span<const Direction> directions, std::size_t samples = 200000);

}  // namespace lightstage::core
