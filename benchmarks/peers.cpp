// How many steps Enki makes of a Khepera among cylinders: a line "SECONDS" in, "STEPS CPU_SECONDS" out.
//
//   peers STEP_S WIDTH DEPTH X Y CYLINDERS (X Y R)...
//
// The robot is Enki's, with its wheels' and its sensors' noise; it steers by a weighted sum of its sensors.
// This file is realitygap's (MIT licence); the program that it compiles to is linked with Enki (GPL-2+).

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <list>
#include <vector>

#include <enki/PhysicalEngine.h>
#include <enki/robots/khepera/Khepera.h>

using namespace Enki;

const long STEPS_AT_ONCE = 2000;

struct Sensor : IRSensor {
    explicit Sensor(const IRSensor &like) : IRSensor(like) {}

    void init(double dt, World *world) {
        IRSensor::init(dt, world);
        std::fill(rayValues.begin(), rayValues.end(), 0.0);  // version 1.6.99 keeps what it saw for ever
    }
};

struct Robot8 : Khepera {
    std::list<Sensor> sensors;

    Robot8() {
        IRSensor *const published[] = {&infraredSensor0, &infraredSensor1, &infraredSensor2, &infraredSensor3,
                                       &infraredSensor4, &infraredSensor5, &infraredSensor6, &infraredSensor7};
        localInteractions.clear();
        for (const IRSensor *one : published) {
            sensors.emplace_back(*one);
            addLocalInteraction(&sensors.back());
        }
    }

    void steer() {
        const double turn[8] = {2, 3, 4, -4, -3, -2, 0, 0};  // from the left round the front to the back
        double sum = 0;
        int i = 0;
        for (const Sensor &sensor : sensors) sum += turn[i++] * sensor.getValue() / 1023;
        leftSpeed = std::max(-8.0, std::min(8.0, 6 + 4 * sum));
        rightSpeed = std::max(-8.0, std::min(8.0, 6 - 4 * sum));
    }
};

int main(int count, char **words) {
    std::vector<double> given;
    for (int i = 1; i < count; ++i) given.push_back(std::atof(words[i]));
    if (given.size() < 6 || given.size() != 6 + 3 * size_t(given[5])) return 2;
    World world(given[1], given[2]);
    world.takeObjectOwnership = false;
    std::list<PhysicalObject> cylinders;
    for (size_t i = 6; i < given.size(); i += 3) {
        cylinders.emplace_back();
        cylinders.back().pos = Point(given[i], given[i + 1]);
        cylinders.back().setCylindric(given[i + 2], 20, -1);
        world.addObject(&cylinders.back());
    }
    Robot8 robot;
    robot.pos = Point(given[3], given[4]);
    world.addObject(&robot);
    for (double seconds; std::cin >> seconds;) {
        const std::clock_t begun = std::clock();
        long steps = 0;
        double spent = 0;
        for (; spent < seconds; spent = double(std::clock() - begun) / CLOCKS_PER_SEC, steps += STEPS_AT_ONCE)
            for (long i = 0; i < STEPS_AT_ONCE; ++i) {
                robot.steer();
                world.step(given[0]);
            }
        std::cout << steps << ' ' << spent << std::endl;
    }
}
