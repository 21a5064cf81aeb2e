#include "drivers/can/socketcan.h"

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>

#include "drivers/can/can_map.h"

namespace servotwin {
namespace {

// Interval of checks whether an interface is back.
constexpr double kLook_s = 0.1;

std::int64_t steady_ns() noexcept {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

CanFrame frame_of(const SocketBatch::Datagram& datagram) noexcept {
  canfd_frame raw{};
  std::memcpy(&raw, datagram.data, std::min(datagram.size, sizeof raw));
  CanFrame frame;
  frame.time_ns = datagram.time_ns;
  frame.error = (raw.can_id & CAN_ERR_FLAG) != 0;
  frame.extended = !frame.error && (raw.can_id & CAN_EFF_FLAG) != 0;
  frame.remote = !frame.error && (raw.can_id & CAN_RTR_FLAG) != 0;
  frame.id = raw.can_id & (frame.extended || frame.error ? CAN_EFF_MASK : CAN_SFF_MASK);
  frame.fd = datagram.size == CANFD_MTU;
  frame.fast = frame.fd && (raw.flags & CANFD_BRS) != 0;
  frame.passive = frame.fd && (raw.flags & CANFD_ESI) != 0;
  const std::size_t most = frame.fd ? CANFD_MAX_DLEN : CAN_MAX_DLEN;
  frame.length = static_cast<std::uint8_t>(std::min<std::size_t>(raw.len, most));
  std::memcpy(frame.data.data(), raw.data, frame.length);
  return frame;
}

}  // namespace

SocketCan::SocketCan(std::string interface, SocketCanOptions options)
    : interface_(std::move(interface)), options_(std::move(options)), batch_(CANFD_MTU) {
  if (const int error = open(); error != 0) {
    const std::string why = std::generic_category().message(error);
    if (error == EAFNOSUPPORT || error == EPROTONOSUPPORT) {
      throw std::runtime_error(interface_ +
                               ": this kernel has no CAN sockets; as root: modprobe can_raw");
    }
    if (error == ENODEV || error == EINVAL) {
      throw std::runtime_error(interface_ +
                               ": there is no such CAN interface; ip link show type can (or vcan) "
                               "lists them");
    }
    throw std::runtime_error(interface_ + ": cannot be opened: " + why);
  }
}

SocketCan::~SocketCan() { close(); }

void SocketCan::close() noexcept {
  if (socket_ >= 0) ::close(socket_);
  socket_ = -1;
}

int SocketCan::open() noexcept {
  const unsigned index = if_nametoindex(interface_.c_str());
  socket_ = ::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW);
  if (socket_ < 0) return errno;
  const auto fail = [&](int error) {
    close();
    return error;
  };
  if (index == 0) return fail(ENODEV);
  const int on = 1;
  setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on);
  const can_err_mask_t errors = CAN_ERR_MASK;
  setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors);
  SocketBatch::prepare(socket_, options_.receive_buffer_bytes);
  if (!options_.only.empty()) {
    std::array<can_filter, CAN_RAW_FILTER_MAX> filters{};
    const std::size_t count = std::min<std::size_t>(options_.only.size(), filters.size());
    for (std::size_t i = 0; i < count; ++i) {
      const CanFilterId& wanted = options_.only[i];
      filters[i].can_id = wanted.id | (wanted.extended ? CAN_EFF_FLAG : 0U);
      filters[i].can_mask = CAN_EFF_FLAG | (wanted.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
    }
    if (setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_FILTER, filters.data(),
                   static_cast<socklen_t>(count * sizeof(can_filter))) != 0) {
      return fail(errno);
    }
  }
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(index);
  if (bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
    return fail(errno);
  dropped_ = 0;
  counters_.up.store(interface_is_up(), std::memory_order_relaxed);
  return 0;
}

bool SocketCan::interface_is_up() const noexcept {
  ifreq request{};
  std::strncpy(request.ifr_name, interface_.c_str(), sizeof request.ifr_name - 1);
  return ioctl(socket_, SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) != 0;
}

void SocketCan::look_after() noexcept {
  const std::int64_t now = steady_ns();
  if (now - looked_ns_ < static_cast<std::int64_t>(kLook_s * 1e9)) return;
  looked_ns_ = now;
  if (socket_ < 0) {
    open();
  } else if (interface_is_up()) {
    counters_.up.store(true, std::memory_order_relaxed);
  }
}

void SocketCan::on_failure(int error) noexcept {
  if (error == EAGAIN || error == EINTR || error == ENOBUFS || error == ENOMEM) return;
  if (counters_.up.load(std::memory_order_relaxed)) count(counters_.downs);
  counters_.up.store(false, std::memory_order_relaxed);
  // A socket remains valid if its interface goes down, but not if it is removed.
  if (error != ENETDOWN) close();
}

std::size_t SocketCan::receive(std::span<CanFrame> batch, double timeout_s) noexcept {
  if (!counters_.up.load(std::memory_order_relaxed)) {
    look_after();
    timeout_s = std::min(timeout_s, kLook_s);
  }
  if (timeout_s > 0.0) wait_readable(socket_, timeout_s);
  if (socket_ < 0) return 0;
  const int came = batch_.receive(socket_, batch.size());
  if (came < 0) {
    on_failure(errno);
    return 0;
  }
  if (came > 0) counters_.up.store(true, std::memory_order_relaxed);
  for (std::size_t i = 0; i < static_cast<std::size_t>(came); ++i) {
    const SocketBatch::Datagram datagram = batch_[i];
    batch[i] = frame_of(datagram);
    if (datagram.has_dropped && datagram.dropped != dropped_) {
      count(counters_.dropped, datagram.dropped - dropped_);
      dropped_ = datagram.dropped;
      batch[i].after_gap = true;
    }
  }
  count(counters_.received, static_cast<std::uint64_t>(came));
  return static_cast<std::size_t>(came);
}

std::size_t SocketCan::send(std::span<const CanFrame> frames) noexcept {
  std::size_t sent = 0;
  for (const CanFrame& frame : frames) {
    canfd_frame raw{};
    raw.can_id =
        frame.id | (frame.extended ? CAN_EFF_FLAG : 0U) | (frame.remote ? CAN_RTR_FLAG : 0U);
    raw.len = frame.length;
    raw.flags =
        static_cast<std::uint8_t>((frame.fast ? CANFD_BRS : 0) | (frame.passive ? CANFD_ESI : 0));
    std::memcpy(raw.data, frame.data.data(), frame.length);
    const std::size_t size = frame.fd ? CANFD_MTU : CAN_MTU;
    if (socket_ < 0 || frame.error || ::write(socket_, &raw, size) != static_cast<ssize_t>(size))
      break;
    ++sent;
  }
  count(counters_.sent, sent);
  count(counters_.not_sent, frames.size() - sent);
  return sent;
}

std::vector<CanFilterId> ids_of(const CanMap& map, std::size_t bus) {
  std::vector<CanFilterId> ids;
  if (map.start.bus == bus) ids.push_back({map.start.id, map.start.extended});
  for (const MappedMessage& message : map.messages) {
    if (message.bus == bus) ids.push_back({message.id, message.extended});
  }
  return ids;
}

}  // namespace servotwin
