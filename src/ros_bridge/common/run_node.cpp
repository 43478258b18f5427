#include "run_node.hpp"

#include <cstdio>

#include <ros/init.h>

#include "client_watch.hpp"
#include "clock_gate.hpp"
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
constexpr double kLastLines = 1.0;  // longest wait for the last lines of a log that is blocked [s]

void spinUntilEnd(EndWatch& end_watch, const Node& node) {
  const auto is_to_end = [&] {
    return EndRequest::isUrgent() || (EndRequest::made() && node.mayEnd()) || ros::isShuttingDown();
  };
  while (!is_to_end()) {
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(kLongestWait));
    end_watch.turn();
  }
}

}  // namespace

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

int runNode(int argc, char** argv, const std::string& name,
            const std::function<std::unique_ptr<Node>()>& make) {
  // Lines appear immediately in pipes and files, too.
  std::setvbuf(stdout, nullptr, _IOLBF, BUFSIZ);
  ClockGate::init(argc, argv, name);
  EndWatch end_watch;
  const ros::NodeHandle started;  // waits for a master; keeps ROS up until faults are printed
  if (!ros::ok()) return kDone;
  LogThread log_thread;
  const EndRequest takes_over;
  return guarded([&]() -> int {
    const ClockGate clock;
    MasterWatch master;
    const std::unique_ptr<Node> node = make();
    const int thrown = guarded([&] {
      spinUntilEnd(end_watch, *node);
      return kDone;
    });
    EndRequest::make();  // whatever ended it, the rest is watched
    end_watch.waits(true);
    const int verdict = node->finish();
    end_watch.waits(false);
    if (master.lost()) end_watch.hurry();
    log_thread.flush(kLastLines);
    ros::shutdown();
    return thrown != kDone || master.lost() ? kFailed : verdict;
  });
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

}  // namespace helix_arm::ros_bridge
