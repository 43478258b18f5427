#include "run_node.hpp"

#include <stdexcept>
#include <utility>

#include <ros/callback_queue.h>

#include "helix_arm/io/fault_list.hpp"
#include "log.hpp"
#include "parameters.hpp"

namespace helix_arm::ros_bridge {
namespace {

int report(const std::exception& error, ExitCode code) {
  logFatal("%s", error.what());
  return code;
}

constexpr double kLongestWait = 0.1;  // for a callback [s]

}  // namespace

void spinUntilEnd(EndWatch& end_watch, const std::function<bool()>& may_end) {
  const auto is_to_end = [&] {
    return EndRequest::isUrgent() || (EndRequest::made() && may_end()) || ros::isShuttingDown();
  };
  while (!is_to_end()) {
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(kLongestWait));
    end_watch.turn();
  }
}

int guarded(const std::function<int()>& body) {
  try {
    return body();
  } catch (const NothingToDo& reason) {
    logInfo("%s", reason.what());
    return kDone;
  } catch (const io::DocumentError& error) {
    return report(error, kBadConfiguration);
  } catch (const ParameterError& error) {
    return report(error, kBadConfiguration);
  } catch (const std::invalid_argument& error) {
    return report(error, kBadConfiguration);
  } catch (const std::exception& error) {
    return report(error, kFailed);
  }
}

void GuardedThread::start(std::function<void()> body, std::function<void()> on_failure) {
  thread_ = std::thread([this, body = std::move(body), on_failure = std::move(on_failure)] {
    const int code = guarded([&body] {
      body();
      return kDone;
    });
    verdict_ = code;
    if (code != kDone) on_failure();
  });
}

void GuardedThread::join() {
  if (thread_.joinable()) thread_.join();
}

}  // namespace helix_arm::ros_bridge
