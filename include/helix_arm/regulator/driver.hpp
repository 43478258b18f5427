#pragma once

#include <Eigen/Core>
#include <limits>
#include <stdexcept>

#include "helix_arm/control/valve_orders.hpp"

namespace helix_arm::regulator {

/// The link to a device is down, or the device is: connect again.
class LinkError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A device answered, but not in its language: garbage, half a line, the wrong unit. The exchange
/// is lost, the link may still be good.
class BadReply : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What a device reads.
struct Pressures {
  explicit Pressures(int channels)
      : pressure(Eigen::VectorXd::Constant(channels, std::numeric_limits<double>::quiet_NaN())) {}

  Eigen::VectorXd pressure;  ///< (channels) gauge [Pa]; NaN: not read this time
  double supply = std::numeric_limits<double>::quiet_NaN();  ///< gauge [Pa]; NaN: not measured
};

/// A pressure regulator as its line speaks it. Units are converted here, once: gauge pascals above.
///
/// One thread uses it. Calls block for at most the device's timeout each exchange.
class Driver {
 public:
  virtual ~Driver() = default;

  /// Opens the link and makes the device ready, vented; an open link is closed first. From then to
  /// close() no other program of this machine gets to the device.
  /// @throws LinkError naming the device, the cause and the remedy.
  virtual void connect() = 0;
  /// Hands the orders to the device.
  /// @throws LinkError, BadReply.
  virtual void write(const control::ValveOrders& orders) = 0;
  /// Readings of all channels, in the arm's order; of a device that answers one channel at a time
  /// perhaps of some, the others NaN.
  /// @throws LinkError, BadReply.
  virtual void read(Pressures& pressures) = 0;
  /// Vents every channel, with as few words as the device allows. After a LinkError, too, as long
  /// as the link is not closed: a device whose answers are lost or late may hear all the same.
  /// @throws LinkError, BadReply.
  virtual void vent() = 0;
  /// Whether the device would keep its air if its link were closed now: one that was told to vent
  /// needs the link until it is empty.
  virtual bool keepsAirOnClose() const noexcept { return false; }
  /// The device vents by itself once no line has come for so long [s]; infinite: it is not known
  /// to. Where it may have, what it regulated is not fed again: write() and read() throw LinkError.
  virtual double watchdog() const noexcept { return std::numeric_limits<double>::infinity(); }
  /// Closes the link, without a word to the device. Nothing to do where it is closed.
  virtual void close() noexcept = 0;
  /// From now on connect() does not mind that another program of this machine drives the device:
  /// for a guard, which must vent whatever else goes on. Of a serial line it stays without effect,
  /// since two cannot speak on one.
  virtual void ignoreOthers() noexcept {}
};

}  // namespace helix_arm::regulator
