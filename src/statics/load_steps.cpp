#include "load_steps.hpp"

#include <algorithm>
#include <utility>

namespace helix_arm::statics {
namespace {

constexpr double kLeastLoadStep = 1e-9;  // of the whole load
constexpr double kBranchEnd = 1e-6;      // step relative to the load at which the branch ends
constexpr int kFewIterations = 5;        // of a step, after which the next one is longer

}  // namespace

Reached stepLoad(const MultipleShooting& shooting, const ExactOptions& options) {
  Reached out;
  out.nodes = shooting.unloadedNodes();
  std::vector<Node> before;
  double share_before = 0.0, load_step = 1.0;
  while (out.share < 1.0) {
    const double target = load_step >= 1.0 - out.share ? 1.0 : out.share + load_step;
    std::vector<Node> guess = out.nodes;
    if (!before.empty()) {
      const double factor = (target - out.share) / (out.share - share_before);
      for (std::size_t j = 0; j < guess.size(); ++j) {
        guess[j].R =
            out.nodes[j].R * lie::SO3::exp(factor * (before[j].R.inverse() * out.nodes[j].R).log());
        guess[j].m += factor * (out.nodes[j].m - before[j].m);
      }
    }
    const int iterations_before = out.iterations;
    Balance balance = shooting.balance(std::move(guess), target, false, out.iterations);
    if (balance.found) {
      before = std::exchange(out.nodes, std::move(balance.nodes));
      share_before = std::exchange(out.share, target);
      ++out.load_steps;
      out.residual = balance.residual;
      if (out.iterations - iterations_before <= kFewIterations) load_step *= 2.0;
      continue;
    }
    if (out.iterations == options.max_iterations) break;
    load_step = 0.5 * (target - out.share);
    if (load_step >= std::max(kLeastLoadStep, kBranchEnd * out.share)) continue;
    // The branch ends here; the arm snaps to another shape, if there is one.
    balance = shooting.balance(out.nodes, 1.0, true, out.iterations);
    if (!balance.found) break;
    out.nodes = std::move(balance.nodes);
    out.residual = balance.residual;
    out.share = 1.0;
    out.snapped = true;
  }
  return out;
}

}  // namespace helix_arm::statics
