// A controller outside of the simulator in C++17: libzmq and msgpack-c (header files alone).
//
//   g++ -std=c++17 -O2 docs/examples/client.cpp -o client -lzmq
//   ./client tcp://127.0.0.1:5555 200
//
// Debian: apt-get install g++ libzmq3-dev libmsgpack-cxx-dev. It moves an object before each visit, and prints each range
// with its sigma.

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <msgpack.hpp>
#include <stdexcept>
#include <string>
#include <vector>
#include <zmq.h>

using Vector = std::array<double, 3>;
using Packer = msgpack::packer<msgpack::sbuffer>;
using Map = std::map<std::string, msgpack::object>;

class Scanner {
public:
    explicit Scanner(const std::string& address)
        : context_(zmq_ctx_new()), socket_(zmq_socket(context_, ZMQ_REQ)) {
        const int wait = 60000, linger = 0;
        zmq_setsockopt(socket_, ZMQ_RCVTIMEO, &wait, sizeof wait);
        zmq_setsockopt(socket_, ZMQ_LINGER, &linger, sizeof linger);
        if (zmq_connect(socket_, address.c_str()) != 0) throw std::runtime_error(zmq_strerror(zmq_errno()));
    }
    ~Scanner() {
        zmq_close(socket_);
        zmq_ctx_term(context_);
    }
    Scanner(const Scanner&) = delete;
    Scanner& operator=(const Scanner&) = delete;

    // Sends a command with `more` keys, which `fill` packs, and returns its answer; a handle owns what maps refer to.
    template <class Fill>
    Map ask(const std::string& command, std::uint32_t more, Fill fill) {
        msgpack::sbuffer buffer;
        Packer packer(buffer);
        packer.pack_map(2 + more);
        packer.pack(std::string("protocol")).pack(1);
        packer.pack(std::string("command")).pack(command);
        fill(packer);
        if (zmq_send(socket_, buffer.data(), buffer.size(), 0) < 0) throw std::runtime_error("not sent");
        zmq_msg_t part;
        zmq_msg_init(&part);
        if (zmq_msg_recv(&part, socket_, 0) < 0) throw std::runtime_error("no answer");
        handle_ = msgpack::unpack(static_cast<const char*>(zmq_msg_data(&part)), zmq_msg_size(&part));
        zmq_msg_close(&part);
        Map answer = handle_.get().as<Map>();
        if (!answer.at("ok").as<bool>()) {
            const Map error = answer.at("error").as<Map>();
            throw std::runtime_error(error.at("message").as<std::string>() + " " +
                                     error.at("remedy").as<std::string>());
        }
        return answer;
    }
    Map ask(const std::string& command) {
        return ask(command, 0, [](Packer&) {});
    }

private:
    void* context_;
    void* socket_;
    msgpack::object_handle handle_;
};

int run(const std::string& address, int visits) {
    Scanner scanner(address);
    Map about = scanner.ask("open");
    const auto targets = about.at("targets").as<std::vector<Map>>();
    const auto object = targets.at(0).at("object").as<std::string>();
    double time = about.at("time").as<double>();
    for (int visit = 0; visit < visits; ++visit) {
        const Vector velocity{0.01, 0.0, 0.0}, position{-0.1 + velocity[0] * time, 0.1, 9.0};
        const Map answer = scanner.ask("step", 1, [&](Packer& packer) {
            packer.pack(std::string("moves")).pack_array(1).pack_map(4);
            packer.pack(std::string("object")).pack(object);
            packer.pack(std::string("position")).pack(position);
            packer.pack(std::string("velocity")).pack(velocity);
            packer.pack(std::string("time")).pack(time);
        });
        time = answer.at("time").as<double>();
        for (const Map& record : answer.at("records").as<std::vector<Map>>())
            if (record.at("status").as<int>() == 0)
                std::printf("%.4f s %s: %.5f m ± %.5f m\n", record.at("time").as<double>(),
                            record.at("target").as<std::string>().c_str(), record.at("range").as<double>(),
                            record.at("sigma_range").as<double>());
        if (answer.at("finished").as<bool>()) break;
    }
    scanner.ask("close");
    return 0;
}

int main(int count, char** words) {
    try {
        return run(count > 1 ? words[1] : "tcp://127.0.0.1:5555", count > 2 ? std::atoi(words[2]) : 100);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "error: %s\n", error.what());
        return 1;
    }
}
