#pragma once

#include <Eigen/Core>

namespace surfel::test {

// What the library's sparse algebra is held against, by Eigen. Compiled once, and optimised in
// every build: matrices of thousands of rows take minutes otherwise.

/// a b.
Eigen::MatrixXd product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// x of a x = b for an invertible matrix.
Eigen::MatrixXd solve(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// The same for one that is symmetric and positive definite. Empty if it is not.
Eigen::MatrixXd solve_definite(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// Of a symmetric matrix, ascending.
Eigen::VectorXd eigenvalues(const Eigen::MatrixXd& a);

}  // namespace surfel::test
