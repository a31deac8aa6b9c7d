#include "capture/preview/tev_link.h"

#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "capture/preview/tev_packets.h"
#include "core/error.h"
#include "core/progress.h"

namespace lightstage::capture {

namespace {

using SteadyClock = std::chrono::steady_clock;

// False when the time is over first.
bool wait_writable(int socket, std::chrono::milliseconds time) {
  const SteadyClock::time_point end = SteadyClock::now() + time;
  while (true) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(end - SteadyClock::now()).count();
    pollfd wanted{socket, POLLOUT, 0};
    const int ready = ::poll(&wanted, 1, static_cast<int>(std::max<std::int64_t>(left, 0)));
    if (ready >= 0 || errno != EINTR) return ready > 0;
  }
}

std::pair<std::string, std::string> host_and_port(const std::string& address) {
  const std::size_t colon = address.rfind(':');
  std::string host = address.substr(0, colon);
  const bool bracketed = host.size() > 2 && host.front() == '[' && host.back() == ']';
  if (bracketed) host = host.substr(1, host.size() - 2);
  if (colon == std::string::npos || host.empty() || (!bracketed && host.find(':') != std::string::npos)) {
    throw core::BadInput("preview: '" + address + "' is no address of a tev viewer: write HOST:PORT, such as " +
                         "127.0.0.1:14158");
  }
  return {host, address.substr(colon + 1)};
}

}  // namespace

TevLink::TevLink(const std::string& address, const TevPatience& patience) : address_(address), patience_(patience) {
  const auto [host, port] = host_and_port(address);
  addrinfo wanted{};
  wanted.ai_socktype = SOCK_STREAM;
  wanted.ai_flags = AI_NUMERICSERV;
  addrinfo* found = nullptr;
  if (const int error = ::getaddrinfo(host.c_str(), port.c_str(), &wanted, &found); error != 0) {
    throw core::BadInput("preview: cannot find the tev viewer's address '" + address + "': " + ::gai_strerror(error));
  }
  for (const addrinfo* a = found; a != nullptr; a = a->ai_next) {
    endpoints_.push_back({a->ai_family, std::string(reinterpret_cast<const char*>(a->ai_addr), a->ai_addrlen)});
  }
  ::freeaddrinfo(found);
}

TevLink::~TevLink() {
  if (socket_ >= 0) ::close(socket_);
}

bool TevLink::show(const std::string& name, const core::Image& image) {
  if (socket_ >= 0 && viewer_is_gone()) disconnect("has closed the connection");
  if (socket_ < 0 && !connect()) return false;
  const auto before = created_.find(name);
  if (before == created_.end() || before->second != image.size()) {
    if (!send(tev_create_packet(name, image.size()))) return false;
    created_[name] = image.size();
  }
  return send(tev_update_packet(name, image));
}

bool TevLink::connect() {
  if (SteadyClock::now() < next_try_) return false;
  int error = 0;
  for (const Endpoint& endpoint : endpoints_) {
    const int socket = ::socket(endpoint.family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (socket < 0) {
      error = errno;
      continue;
    }
    const auto* address = reinterpret_cast<const sockaddr*>(endpoint.address.data());
    error = ::connect(socket, address, static_cast<socklen_t>(endpoint.address.size())) == 0 ? 0 : errno;
    if (error == EINPROGRESS) {
      socklen_t size = sizeof error;
      if (!wait_writable(socket, patience_.stall)) {
        error = ETIMEDOUT;
      } else if (::getsockopt(socket, SOL_SOCKET, SO_ERROR, &error, &size) != 0) {
        error = errno;
      }
    }
    if (error == 0) {
      socket_ = socket;
      last_note_.clear();
      return true;
    }
    ::close(socket);
  }
  disconnect(std::string("does not listen (") + std::strerror(error) + ")");
  return false;
}

bool TevLink::send(const std::string& packet) {
  const SteadyClock::time_point end = SteadyClock::now() + patience_.packet;
  std::size_t sent = 0;
  while (sent < packet.size()) {
    const ssize_t n = ::send(socket_, packet.data() + sent, packet.size() - sent, MSG_NOSIGNAL);
    if (n >= 0) {
      sent += static_cast<std::size_t>(n);
    } else if (errno == EAGAIN) {
      if (SteadyClock::now() < end && wait_writable(socket_, patience_.stall)) continue;
      // What was sent of the packet cannot be taken back: only a new connection begins at a packet's start.
      disconnect("does not read what it is sent");
      return false;
    } else if (errno != EINTR) {
      disconnect(std::string("went away (") + std::strerror(errno) + ")");
      return false;
    }
  }
  return true;
}

void TevLink::disconnect(const std::string& why) {
  if (socket_ >= 0) ::close(std::exchange(socket_, -1));
  created_.clear();
  next_try_ = SteadyClock::now() + patience_.retry;
  if (why == last_note_) return;
  last_note_ = why;
  core::note("preview: the tev viewer at " + address_ + " " + why +
             "; capture goes on, it is tried again now and then");
}

// tev never sends anything: what can be read is the end of the connection.
bool TevLink::viewer_is_gone() const {
  char byte = 0;
  const ssize_t n = ::recv(socket_, &byte, 1, MSG_DONTWAIT | MSG_PEEK);
  return n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR);
}

}  // namespace lightstage::capture
