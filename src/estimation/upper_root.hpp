#pragma once

#include <Eigen/Core>
#include <vector>

/// Cholesky factors of symmetric matrices of some hundred columns, in the vector instructions of
/// the processor. Matrices are row major; of a symmetric one, only the upper triangle is read.
namespace helix_arm::estimation {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Columns of some matrices are padded with zeros to a multiple of this.
inline constexpr int kRowPadding = 8;
inline int padded(int columns) { return (columns + kRowPadding - 1) / kRowPadding * kRowPadding; }

/// Replaces the upper triangle of S by U, S = U'U. The rest stays.
/// @return false if S is not positive definite.
bool factorUpper(RowMajor& S);

/// Replaces x by the solution of U'U x = b.
void solveUpper(const RowMajor& U, Eigen::VectorXd& x);

/// Replaces X by U'^-1 X.
///
/// @param X  (any x padded columns).
void divideByTransposed(const RowMajor& U, RowMajor& X);
/// Replaces x (any) by U'^-1 x.
void divideByTransposed(const RowMajor& U, Eigen::VectorXd& x);

/// (U'U)^-1, both triangles.
RowMajor inverseOfUpper(const RowMajor& U);

/// Replaces the first `count` rows of `square`, from their diagonal on, by those of weight * W'W.
///
/// @param W  (rows x stride) row major. @param stride  padded(). @param square  (count x stride).
void squareRows(const double* W, int rows, int stride, int count, double weight, double* square);

/// Subtracts W'W from the upper triangle of S: row and column i of W'W from row and column at[i].
///
/// @param W  (rows x padded columns). @param at  (columns) ascending. @param square  workspace.
void subtractSquare(const RowMajor& W, const std::vector<int>& at, std::vector<double>& square,
                    RowMajor& S);

}  // namespace helix_arm::estimation
