#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/solve/direct_solve.h>

#include "solve/test_systems.h"

namespace surfel {
namespace {

using namespace surfel::test;

TEST(DirectSolve, EqualsDenseFactorisation) {
  const System system = gaussian_gram(25, 0.7);
  const Eigen::MatrixXd truth = solve_definite(dense(system.matrix), dense(system.b));
  EXPECT_LT((dense(direct_solve(system.matrix, system.b)) - truth).norm(), 1e-9 * truth.norm());
}

TEST(DirectSolve, RejectsIndefiniteMatrices) {
  Eigen::MatrixXd a = dense(gaussian_gram(10, 0.7).matrix);
  a.diagonal().array() -= 0.5;
  try {
    direct_solve(sparse(a), Array<Channels>(100, Channels(1, 1, 1, 1)));
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kNumeric);
    EXPECT_NE(std::string(error.what()).find("not positive definite"), std::string::npos);
  }
}

TEST(DirectSolve, NoUnknowns) {
  SymmetricMatrix none;
  none.row_begin.push_back(0);
  EXPECT_TRUE(direct_solve(none, {}).empty());
}

}  // namespace
}  // namespace surfel
