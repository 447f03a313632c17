#pragma once

#include <string>

#include <surfel/base/function_ref.h>
#include <surfel/view/view_service.h>

namespace surfel::view_tool {

/// Answers the request that arrives at a socket within the limits of a server, and closes it.
void answer_connection(const ViewService& service, int socket);

/// Answers requests on a free port of the loopback interface until the run is interrupted.
/// \param ready  is called with the port once connections are taken.
///
/// Throws Error(kIo) where no port is to be had.
void serve(const ViewService& service, FunctionRef<void(int port)> ready);

}  // namespace surfel::view_tool
