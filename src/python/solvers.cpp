#include "solvers.hpp"

#include <utility>

namespace helix_arm::python {
namespace {

constexpr std::size_t kMostKept = 64;

// Of the options that callers can choose.
bool same(const statics::InverseOptions& a, const statics::InverseOptions& b) {
  return a.preference == b.preference && a.cocontraction == b.cocontraction &&
         a.position_tolerance == b.position_tolerance;
}

}  // namespace

Solvers::Solvers(const statics::ArmModel& model) : model_(model) {
  kept_.reserve(kMostKept);  // giving back does not allocate
}

Solvers::Loan::~Loan() { owner_.giveBack(options_, std::move(solver_)); }

Solvers::Loan Solvers::take(const statics::InverseOptions& options) {
  {
    const std::lock_guard<std::mutex> lock(guard_);
    if (same(options, options_) && !kept_.empty()) {
      std::unique_ptr<statics::InverseSolver> solver = std::move(kept_.back());
      kept_.pop_back();
      return Loan(*this, options, std::move(solver));
    }
  }
  return Loan(*this, options, std::make_unique<statics::InverseSolver>(model_, options));
}

void Solvers::giveBack(const statics::InverseOptions& options,
                       std::unique_ptr<statics::InverseSolver> solver) noexcept {
  const std::lock_guard<std::mutex> lock(guard_);
  if (!same(options, options_)) kept_.clear();
  options_ = options;
  if (kept_.size() < kMostKept) kept_.push_back(std::move(solver));
}

}  // namespace helix_arm::python
