// The way to an image viewer that may be there or not.
#pragma once

#include <chrono>
#include <map>
#include <string>
#include <vector>

#include "core/image.h"

namespace lightstage::capture {

// Durations of the wall clock: a viewer lives in real time, even where the session's clock is virtual.
struct TevPatience {
  std::chrono::milliseconds stall{300};    // to connect, and for the viewer to take any more of a packet
  std::chrono::milliseconds packet{2000};  // for a whole packet
  std::chrono::milliseconds retry{5000};   // between tries to connect
};

// A connection to tev that is made when there is something to show. A viewer that is not there, goes away or stops reading
// costs what TevPatience says and one note each time that it changes; it is tried again when something is to be shown and
// the time of `retry` is over.
class TevLink {
 public:
  // "HOST:PORT", "[ADDRESS]:PORT" for IPv6. Looks the name up here and never again, since that may take long. Throws
  // BadInput for an address of another form and for a name that is not known.
  explicit TevLink(const std::string& address, const TevPatience& patience = {});
  ~TevLink();
  TevLink(const TevLink&) = delete;
  TevLink& operator=(const TevLink&) = delete;

  // Shows the image (1 or 3 channels) under this name, in place of the one before. False when it was not sent.
  bool show(const std::string& name, const core::Image& image);

 private:
  struct Endpoint {
    int family = 0;
    std::string address;  // a sockaddr's bytes
  };

  bool connect();
  bool send(const std::string& packet);
  void disconnect(const std::string& why);
  bool viewer_is_gone() const;

  std::string address_;
  TevPatience patience_;
  std::vector<Endpoint> endpoints_;
  int socket_ = -1;
  std::map<std::string, core::ImageSize> created_;  // by this connection
  std::chrono::steady_clock::time_point next_try_{};
  std::string last_note_;
};

}  // namespace lightstage::capture
