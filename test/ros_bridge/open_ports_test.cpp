// Who can reach the nodes: the environment that the launch files give them, and the sockets on
// which a launched node listens.
#include <cstdio>
#include <filesystem>
#include <regex>
#include <set>
#include <sstream>
#include <stdexcept>

#include <gtest/gtest.h>
#include <xmlrpcpp/XmlRpcClient.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include "support/process.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

const fs::path kLaunch = HELIX_ARM_SOURCE_DIR "/launch";

// A command in a shell in which only these are set of ROS_HOSTNAME and ROS_IP.
Words inShell(const Words& set, const Words& command) {
  Words all = {"env", "-u", "ROS_HOSTNAME", "-u", "ROS_IP"};
  all.insert(all.end(), set.begin(), set.end());
  all.insert(all.end(), command.begin(), command.end());
  return all;
}

struct Shell {
  const char* name;
  Words set, arguments;
  std::string host;  // by which the nodes are to be reached
};
void PrintTo(const Shell& shell, std::ostream* out) { *out << shell.name; }

std::string outputOf(const Words& command) {
  Process process(command);
  if (process.exitCode() != 0) throw std::runtime_error(process.output());
  return process.output();
}

class LaunchFiles : public ::testing::TestWithParam<Shell> {
 protected:
  // What it takes to have all nodes of a file; {{}} where it is not among these.
  static std::vector<Words> variantsOf(const std::string& file) {
    if (file == "arm.launch") {
      return {{"vision:=rendered", "closed_loop:=true", "calibration:=true", "workspace:=true"}};
    }
    if (file == "demo.launch") return {{}, {"calibration:=true"}};
    if (file == "follow.launch") return {{"path:=circle"}};
    if (file == "vision.launch") return {{}, {"manager:=/eyes"}};
    if (file == "two_machines.launch") {
      return {{"role:=control", "rig:=true"},
              {"role:=camera", "commander:=true", "data:=tour_3", "rviz:=true"}};
    }
    return {{}};
  }
  // The nodes' names, each with its ROS_HOSTNAME ("None" without one).
  static std::map<std::string, std::string> hostsOf(const fs::path& file, const Words& arguments) {
    const std::string script =
        "import sys, roslaunch.config as config\n"
        "for node in config.load_config_default([(sys.argv[1], sys.argv[2:])], None).nodes:\n"
        "    print('node', node.name, dict(node.env_args).get('ROS_HOSTNAME'))\n";
    Words command = {"python3", "-c", script, file};
    command.insert(command.end(), arguments.begin(), arguments.end());
    std::map<std::string, std::string> out;
    std::istringstream lines(outputOf(inShell(GetParam().set, command)));
    for (std::string word, name, host; lines >> word;) {
      if (word == "node" && lines >> name >> host) out[name] = host;
    }
    return out;
  }
};

INSTANTIATE_TEST_SUITE_P(
    , LaunchFiles,
    ::testing::Values(Shell{"BareShell", {}, {}, "localhost"},
                      Shell{"ShellWithAHostname", {"ROS_HOSTNAME=robot"}, {}, "robot"},
                      Shell{"ShellWithAnAddress", {"ROS_IP=192.0.2.7"}, {}, "192.0.2.7"},
                      Shell{"Argument", {"ROS_HOSTNAME=robot"}, {"host:=192.0.2.8"}, "192.0.2.8"}),
    [](const auto& shell) { return shell.param.name; });

TEST_P(LaunchFiles, GiveEveryNodeItsHost) {
  const std::regex declared("<node [^>]*name=\"([^\"]*)\"");
  int files = 0;
  for (const auto& entry : fs::directory_iterator(kLaunch)) {
    const std::string file = entry.path().filename(), text = contentOf(entry.path());
    // The address by which another machine reaches this one has no default.
    if (file == "two_machines.launch" && GetParam().arguments.empty()) continue;
    ++files;
    std::set<std::string> expected, seen;
    for (std::sregex_iterator at(text.begin(), text.end(), declared), end; at != end; ++at) {
      expected.insert((*at)[1]);
    }
    for (Words arguments : variantsOf(file)) {
      arguments.insert(arguments.end(), GetParam().arguments.begin(), GetParam().arguments.end());
      for (const auto& [name, host] : hostsOf(entry.path(), arguments)) {
        EXPECT_EQ(host, GetParam().host) << name << " of " << file;
        seen.insert(name);
      }
    }
    for (const std::string& name : expected) {
      EXPECT_EQ(seen.count(name), 1u) << name << " of " << file << " was not started: variantsOf()";
    }
  }
  EXPECT_GT(files, 0);
}

TEST(TwoMachines, AsksForTheAddressOfThisOne) {
  Process launch(
      inShell({}, {"roslaunch", "--nodes", kLaunch / "two_machines.launch", "role:=control"}));
  EXPECT_NE(launch.exitCode(), 0);
  EXPECT_NE(launch.output().find("'host'"), std::string::npos) << launch.output();
}

// TCP sockets that listen: port, address.
using Listeners = std::set<std::pair<int, std::string>>;

constexpr char kLoopback[] = "127.0.0.1";
constexpr char kEverywhere[] = "0.0.0.0";

Listeners listenersOf(int process) {
  std::istringstream rows(outputOf({"ss", "-Hltnp"}));
  const std::string wanted = "pid=" + std::to_string(process) + ",";
  Listeners out;
  for (std::string row; std::getline(rows, row);) {
    if (row.find(wanted) == std::string::npos) continue;
    std::istringstream columns(row);
    std::string state, received, sent, local;
    columns >> state >> received >> sent >> local;
    const std::size_t colon = local.rfind(':');
    out.emplace(std::stoi(local.substr(colon + 1)), local.substr(0, colon));
  }
  return out;
}

// By which its network knows this machine; an address of its own alone where it has no network.
std::string addressOfThisMachine() {
  std::istringstream addresses(outputOf({"hostname", "-I"}));
  for (std::string one; addresses >> one;) {
    if (one.find(':') == std::string::npos) return one;
  }
  return "127.0.0.2";
}

// arm.launch, with a master of its own.
class Arm {
 public:
  Arm(const Words& set, const Words& arguments)
      : port_(freePort()),
        launch_(command(set, arguments),
                {{"ROS_MASTER_URI", "http://localhost:" + std::to_string(port_)}}) {
    if (!launch_.prints("loop at")) throw std::runtime_error("no arm:\n" + launch_.output());
    XmlRpc::XmlRpcValue node;
    node[0] = kCaller;
    node[1] = "/pressure_command";
    const std::string uri = ask(port_, "lookupNode", node);
    char host[256] = "";
    if (std::sscanf(uri.c_str(), "http://%255[^:]:%d/", host, &calls_) != 2) {
      throw std::runtime_error(uri + " is no address of a node");
    }
    host_ = host;
    XmlRpc::XmlRpcValue topic;
    topic[0] = kCaller;
    topic[1] = "/model";
    topic[2][0][0] = "TCPROS";
    topics_ = ask(calls_, "requestTopic", topic)[2];
  }

  const std::string& host() const { return host_; }  ///< that the node tells the others
  int masterPort() const { return port_; }
  int calls() const { return calls_; }    ///< port of the node's XML-RPC
  int topics() const { return topics_; }  ///< port of the node's topics and services
  Listeners node() const { return listenersOf(processAt(calls_)); }
  Listeners master() const { return listenersOf(processAt(port_)); }

 private:
  static constexpr char kCaller[] = "/open_ports_test";

  Words command(const Words& set, const Words& arguments) const {
    Words launch = {"roslaunch",           "-p",
                    std::to_string(port_), kLaunch / "arm.launch",
                    "rviz:=false",         "scene:=spatial_50"};
    launch.insert(launch.end(), arguments.begin(), arguments.end());
    return inShell(set, launch);
  }
  static XmlRpc::XmlRpcValue ask(int port, const char* method,
                                 const XmlRpc::XmlRpcValue& arguments) {
    XmlRpc::XmlRpcClient client(kLoopback, port, "/");
    XmlRpc::XmlRpcValue answer;
    if (!client.execute(method, arguments, answer) || static_cast<int>(answer[0]) != 1) {
      throw std::runtime_error(std::string(method) + " is not answered: " + answer.toXml());
    }
    return answer[2];
  }
  // The node or master itself is asked: roslaunch says it on a standard output that Python holds
  // back in a pipe.
  static int processAt(int port) {
    XmlRpc::XmlRpcValue caller;
    caller[0] = kCaller;
    return ask(port, "getPid", caller);
  }

  int port_;
  Process launch_;
  std::string host_;
  int calls_ = 0, topics_ = 0;
};

// roscpp binds its XML-RPC server to all addresses, whatever is configured
// (docs/safety.md, "Who may command"): the one exception.
TEST(OpenPorts, WithLocalhostInTheShellMasterAndTopicsAreForThisMachine) {
  const Arm arm({"ROS_HOSTNAME=localhost"}, {});
  EXPECT_EQ(arm.host(), "localhost");
  EXPECT_EQ(arm.node(), (Listeners{{arm.topics(), kLoopback}, {arm.calls(), kEverywhere}}));
  EXPECT_EQ(arm.master(), (Listeners{{arm.masterPort(), kLoopback}}));
}

TEST(OpenPorts, InABareShellTopicsAreForThisMachineAndTheMasterIsNot) {
  Process known({"sh", "-c", "getent hosts \"$(hostname)\""});
  if (known.exitCode() != 0) GTEST_SKIP() << "no name to resolve: roslaunch needs ROS_HOSTNAME";
  const Arm arm({}, {});
  EXPECT_EQ(arm.host(), "localhost");
  EXPECT_EQ(arm.node(), (Listeners{{arm.topics(), kLoopback}, {arm.calls(), kEverywhere}}));
  EXPECT_EQ(arm.master(), (Listeners{{arm.masterPort(), kEverywhere}}));
}

TEST(OpenPorts, AnAddressOpensTheTopicsToItsNetwork) {
  const std::string address = addressOfThisMachine();
  const Arm arm({"ROS_HOSTNAME=localhost"}, {"host:=" + address});
  EXPECT_EQ(arm.host(), address);
  EXPECT_EQ(arm.node(), (Listeners{{arm.topics(), kEverywhere}, {arm.calls(), kEverywhere}}));
}

}  // namespace
}  // namespace helix_arm::test
