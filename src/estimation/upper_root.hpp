#pragma once

#include <Eigen/Core>
#include <vector>

/// Cholesky factors of symmetric matrices of some hundred columns, in the vector instructions of
/// the processor. Matrices are row major; of a symmetric one, only the upper triangle is read.
namespace helix_arm::estimation {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Replaces the upper triangle of S by U, S = U'U. The rest stays.
/// @return false if S is not positive definite.
bool factorUpper(RowMajor& S);

/// Replaces x by the solution of U'U x = b.
void solveUpper(const RowMajor& U, Eigen::VectorXd& x);

/// (U'U)^-1, both triangles.
RowMajor inverseOfUpper(const RowMajor& U);

/// Adds factor * W'W to a square matrix: in its row and column `at[i]`, row and column i of W'W.
/// Upper triangle alone.
///
/// @param at  (columns of W) ascending.
void addSquare(const RowMajor& W, double factor, const std::vector<int>& at, RowMajor& S);

}  // namespace helix_arm::estimation
