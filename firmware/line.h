#pragma once

/// Takes one received byte, if there is one, and answers a line that it ends: the protocol of
/// config/regulators/generic.yaml.
void lineRun(void);
/// One millisecond: drops a line that stands still.
void lineTick(void);
