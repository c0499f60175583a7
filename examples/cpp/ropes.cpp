// Asks strand for the ropes in depth images, over the pipes of a process that this program starts once.
//
// c++ -std=c++17 -O2 examples/cpp/ropes.cpp -o ropes
// ./ropes python examples/cpp/serve_ropes.py RADIUS WIDTH HEIGHT FX FY CX CY SCALE FILE ...
//
// A FILE has the pixels of a depth image: whole numbers of 16 bits, without a head. A camera's buffer is the same.

#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

struct Rope {
    double radius = 0, confidence = 0;
    int closed = 0;
    std::vector<double> nodes;  // x, y, z of each node in order, metres
};

struct Answer {
    std::string error;      // why there is no answer; empty if there is one
    double confidence = 0;  // probability that all ropes run as they say
    std::vector<Rope> ropes;
};

class Strand {
public:
    Strand(const char *python, const char *script, const char *radius) {
        int down[2], up[2];
        if (pipe(down) || pipe(up)) throw std::runtime_error("no pipes");
        child_ = fork();
        if (child_ < 0) throw std::runtime_error("no process");
        if (child_ == 0) {
            dup2(down[0], STDIN_FILENO);
            dup2(up[1], STDOUT_FILENO);
            for (int end : {down[0], down[1], up[0], up[1]}) close(end);
            execlp(python, python, script, radius, static_cast<char *>(nullptr));
            _exit(127);
        }
        close(down[0]);
        close(up[1]);
        to_ = fdopen(down[1], "wb");
        from_ = fdopen(up[0], "rb");
    }
    Strand(const Strand &) = delete;
    Strand &operator=(const Strand &) = delete;
    ~Strand() {
        fclose(to_);  // the end of its input ends the process
        fclose(from_);
        waitpid(child_, nullptr, 0);
    }

    // camera: "WIDTH HEIGHT FX FY CX CY SCALE", with SCALE in metres per unit
    Answer ask(const std::string &camera, const std::vector<std::uint16_t> &depth) {
        fprintf(to_, "%s\n", camera.c_str());
        fwrite(depth.data(), sizeof(depth[0]), depth.size(), to_);
        fflush(to_);
        Answer answer;
        char word[8] = "";
        if (fscanf(from_, " %7s", word) != 1) throw std::runtime_error("strand has ended; see its standard error");
        if (std::string(word) == "error") {
            fgetc(from_);  // the space
            for (int letter; (letter = fgetc(from_)) != '\n' && letter != EOF;) answer.error += char(letter);
            return answer;
        }
        std::size_t ropes = 0;
        expect(2, fscanf(from_, "%zu %lf", &ropes, &answer.confidence));
        for (; ropes; --ropes) {
            Rope rope;
            std::size_t count = 0;
            expect(4, fscanf(from_, " rope %zu %lf %d %lf", &count, &rope.radius, &rope.closed, &rope.confidence));
            rope.nodes.resize(3 * count);
            for (double &number : rope.nodes) expect(1, fscanf(from_, "%lf", &number));
            answer.ropes.push_back(rope);
        }
        return answer;
    }

private:
    static void expect(int wanted, int got) {
        if (got != wanted) throw std::runtime_error("strand's answer was cut off");
    }
    pid_t child_ = -1;
    FILE *to_ = nullptr, *from_ = nullptr;
};

int main(int count, char **words) try {
    if (count < 12) throw std::runtime_error("usage: ropes PYTHON SCRIPT RADIUS WIDTH HEIGHT FX FY CX CY SCALE FILE ...");
    signal(SIGPIPE, SIG_IGN);  // the answer says that the process has ended
    Strand strand(words[1], words[2], words[3]);
    std::string camera = words[4];
    for (int k = 5; k < 11; ++k) camera += std::string(" ") + words[k];
    const std::size_t pixels = std::stoul(words[4]) * std::stoul(words[5]);
    for (int k = 11; k < count; ++k) {
        std::ifstream file(words[k], std::ios::binary);
        std::vector<std::uint16_t> depth(pixels);
        file.read(reinterpret_cast<char *>(depth.data()), std::streamsize(2 * pixels));
        if (std::size_t(file.gcount()) != 2 * pixels) {
            // the process waits for the next image
            std::cout << "no answer: " << words[k] << ": expected " << 2 * pixels << " bytes for " << words[4] << " x "
                      << words[5] << " pixels, got " << (file.is_open() ? std::to_string(file.gcount()) : "no file") << "\n";
            continue;
        }
        const Answer answer = strand.ask(camera, depth);
        if (!answer.error.empty()) std::cout << "no answer: " << answer.error << "\n";
        for (const Rope &rope : answer.ropes)
            std::cout << rope.nodes.size() / 3 << " nodes, first at " << rope.nodes[0] << " " << rope.nodes[1] << " "
                      << rope.nodes[2] << ", radius " << rope.radius << ", confidence " << rope.confidence << "\n";
    }
    return 0;
} catch (const std::exception &error) {
    std::cerr << error.what() << "\n";
    return 1;
}
