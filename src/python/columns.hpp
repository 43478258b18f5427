#pragma once

#include <cstddef>
#include <cstdint>

/// Rows to columns and back, vectorised for the instruction set of the machine.
namespace helix_arm::python {

/// Rows of n numbers, one after the other, to n columns of `count` numbers.
void splitRows(const double* rows, std::size_t n, std::size_t count, double* const* columns);

/// Three columns to rows of three.
/// @param past_caches  whether the rows, which are not read soon, are written without reading their
///     memory first; then call finishRows() before another thread reads them.
void joinRows(const double* x, const double* y, const double* z, std::size_t count,
              bool past_caches, double* rows);
void finishRows();

/// How many of these are not within [lower, upper]; NaN is not.
std::int64_t countOutside(const double* values, std::size_t count, double lower, double upper);

}  // namespace helix_arm::python
