#pragma once

#include <QColor>
#include <QLabel>
#include <QString>
#include <QWidget>
#include <string>

#include "fixed_text.hpp"
#include "ros_bridge/cockpit/cockpit_words.hpp"

/// What the boxes of the cockpit share.
namespace helix_arm::rviz_panel {

QColor colorOf(ros_bridge::Tone tone);

/// Colour of an actuator's curve in the strip chart, and of its name beside the slider. None of
/// them means anything in the 3D view or as a Tone.
QColor colorOfChannel(int channel);

/// A label of plain text that wraps, with an object name.
QLabel* makeText(QWidget* parent, const char* name);

/// Shows words in the colour of their tone; hides the label where there are none. A FixedText keeps
/// its place.
void showWords(QLabel* label, const std::string& text, ros_bridge::Tone tone);

/// Greys a widget out where its action is not possible, with the reason as its tooltip.
/// @param what  tooltip where it is possible.
void offer(QWidget* widget, const ros_bridge::Possibility& possibility, const char* what);

}  // namespace helix_arm::rviz_panel
