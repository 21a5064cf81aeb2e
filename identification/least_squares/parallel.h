// Independent pieces of a computation on several threads. The result must not depend on the order
// in which the pieces are done, so that it is the same to the last bit on any number of threads.
//
// Any thread. A call within a piece does its own pieces one after the other.
#pragma once

#include <cstddef>
#include <functional>

namespace servotwin {

/// How many threads computations of this process use from now on; at least 1, which is the value at
/// the start. New threads inherit the scheduling of the one that needs them.
void use_threads(std::size_t count);

/// Memory that is freed from now on is kept and used again, up to half a gigabyte: for a process
/// that calculates and ends. In a diagnosis matrices of megabytes come and go thousands of times;
/// given back to the system, each of them would cost its page faults anew, a quarter of the whole
/// time.
void keep_freed_memory();

/// Calls work(0) .. work(count - 1), each once. Throws what the first of them by index throws,
/// after all that began have ended; Interrupted where the calling thread is interrupted.
void in_parallel(std::size_t count, const std::function<void(std::size_t)>& work);

}  // namespace servotwin
