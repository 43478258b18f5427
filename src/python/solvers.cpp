#include "solvers.hpp"

#include <algorithm>
#include <iterator>
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
    const basics::MutexLock lock(mutex_);
    const auto found = std::find_if(kept_.rbegin(), kept_.rend(), [&options](const Kept& one) {
      return same(one.options, options);
    });
    if (found != kept_.rend()) {
      std::unique_ptr<statics::InverseSolver> solver = std::move(found->solver);
      kept_.erase(std::prev(found.base()));
      return Loan(*this, options, std::move(solver));
    }
  }
  auto solver = std::make_unique<statics::InverseSolver>(model_, options);
  ++made_;
  return Loan(*this, options, std::move(solver));
}

void Solvers::giveBack(const statics::InverseOptions& options,
                       std::unique_ptr<statics::InverseSolver> solver) noexcept {
  std::unique_ptr<statics::InverseSolver> oldest;  // ends without the lock
  const basics::MutexLock lock(mutex_);
  if (kept_.size() == kMostKept) {
    oldest = std::move(kept_.front().solver);
    kept_.erase(kept_.begin());
  }
  kept_.push_back({options, std::move(solver)});
}

}  // namespace helix_arm::python
