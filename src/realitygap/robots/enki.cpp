// One robot of Enki's in a room, by a line of text in and a line of numbers out: a process of its own.
//
//   enter MODEL SEED NOISE TRACK LEFT RIGHT N GAIN... TURN... WIDTH DEPTH C (X Y R)... W (X0 Y0 X1 Y1)...
//         a unit of khepera, epuck or thymio2 in a new world: NOISE multiplies Enki's noise, TRACK, LEFT
//         and RIGHT its axle and its wheels, GAIN each sensor's response; TURN (rad) turns its direction.
//         Answer, as published: axle, top speed, wheels' noise, radius, then of each sensor
//         x, y, direction, most, noise
//   place X Y HEADING       set it down; it stands for a step. Answer: as of run
//   run N LEFT RIGHT        N steps at these wheel speeds. Answer: x, y, heading of each, then both
//                           wheels' ways since it was set down, both speeds, and what the sensors read
//
// Lengths cm, angles rad, speeds cm/s, readings in counts. Ends with its input.
//
// This file is realitygap's (MIT licence). The program that it compiles to is linked with Enki, which is
// under the GNU General Public License, version 2 or later; so that program is, too.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <map>
#include <memory>
#include <new>
#include <sstream>
#include <string>
#include <vector>

#include <enki/PhysicalEngine.h>
#include <enki/robots/e-puck/EPuck.h>
#include <enki/robots/khepera/Khepera.h>
#include <enki/robots/thymio2/Thymio2.h>

using namespace Enki;

const double STEP_S = 0.02;        // part of the model: the wheels' noise is drawn anew each step
const double BOARD_CM = 0.6;       // a partition's thickness
const double HIGH_CM = 20;         // of whatever stands in the room: every sensor sees it
const int SIDES = 256;             // of a cylinder that is none
const double FIXED = -1;           // mass of what cannot be moved

// Enki handles objects in the order of their addresses. Here that order is always the same: the robot, then
// what stands in the room, and so is all that follows.
const size_t ROBOT_BYTES = 1 << 16;
alignas(64) char space[ROBOT_BYTES + (1 << 22)];
PhysicalObject *const things = reinterpret_cast<PhysicalObject *>(space + ROBOT_BYTES);
const size_t MOST_THINGS = (sizeof(space) - ROBOT_BYTES) / sizeof(PhysicalObject);

// A published sensor on a unit of its own.
class Sensor : public IRSensor {
    const double gain;

public:
    Sensor(Robot *owner, const IRSensor &like, double gain, double turn, double noise)
        : IRSensor(owner, like.*(&Sensor::pos), like.*(&Sensor::height), like.*(&Sensor::orientation) + turn,
                   like.*(&Sensor::range), like.*(&Sensor::m), like.*(&Sensor::x0), like.*(&Sensor::c),
                   like.*(&Sensor::noiseSd) * noise),
          gain(gain) {}

    void init(double dt, World *world) {
        IRSensor::init(dt, world);
        std::fill(rayValues.begin(), rayValues.end(), 0.0);  // version 1.6.99 keeps what it saw for ever
    }

    void finalize(double dt, World *world) {
        for (double &value : rayValues) value *= gain;
        IRSensor::finalize(dt, world);
    }

    static void tell(std::ostream &out, const IRSensor &one) {
        const Vector at = one.*(&Sensor::pos);
        out << ' ' << at.x << ' ' << at.y << ' ' << one.*(&Sensor::orientation) << ' ' << one.*(&Sensor::m)
            << ' ' << one.*(&Sensor::noiseSd);
    }
};

// A robot with the sensors, wheels and noise of one unit.
struct Unit {
    std::vector<std::unique_ptr<Sensor>> sensors;
    double wheels[2];

    virtual ~Unit() {}
    virtual DifferentialWheeled &robot() = 0;
};

template <class Model>
struct UnitOf : Unit, Model {
    UnitOf(std::istream &in, double noise, const std::vector<IRSensor Model::*> &published, std::ostream &out) {
        out << this->distBetweenWheels << ' ' << this->maxSpeed << ' ' << this->noiseAmount << ' '
            << this->getRadius();
        double track;
        size_t count;
        in >> track >> wheels[0] >> wheels[1] >> count;
        std::vector<double> gains(published.size()), turns(published.size());
        if (count != published.size()) in.setstate(std::ios::failbit);
        for (double &gain : gains) in >> gain;
        for (double &turn : turns) in >> turn;
        this->distBetweenWheels *= track;
        this->noiseAmount *= noise;
        this->localInteractions.clear();
        for (size_t i = 0; i < published.size(); ++i) {
            const IRSensor &one = this->*published[i];
            Sensor::tell(out, one);
            sensors.emplace_back(new Sensor(this, one, gains[i], turns[i], noise));
            this->addLocalInteraction(sensors.back().get());
        }
    }

    DifferentialWheeled &robot() { return *this; }
};

template <class Model>
std::vector<IRSensor Model::*> eight() {
    return {&Model::infraredSensor0, &Model::infraredSensor1, &Model::infraredSensor2, &Model::infraredSensor3,
            &Model::infraredSensor4, &Model::infraredSensor5, &Model::infraredSensor6, &Model::infraredSensor7};
}

template <class Model>
Unit *made(std::istream &in, double noise, const std::vector<IRSensor Model::*> &published, std::ostream &out) {
    static_assert(sizeof(UnitOf<Model>) <= ROBOT_BYTES, "a robot has its room");
    return new (space) UnitOf<Model>(in, noise, published, out);
}

Unit *unit_of(const std::string &model, std::istream &in, double noise, std::ostream &out) {
    typedef Thymio2 T;
    if (model == "khepera") return made<Khepera>(in, noise, eight<Khepera>(), out);
    if (model == "epuck") return made<EPuck>(in, noise, eight<EPuck>(), out);
    if (model == "thymio2")
        return made<T>(in, noise, {&T::infraredSensor0, &T::infraredSensor1, &T::infraredSensor2,
            &T::infraredSensor3, &T::infraredSensor4, &T::infraredSensor5, &T::infraredSensor6}, out);
    in.setstate(std::ios::failbit);
    return nullptr;
}

typedef std::vector<std::vector<double>> Rows;

// So many rows of `width` numbers as the first word says.
Rows rows(std::istream &in, size_t width) {
    size_t count = 0;
    in >> count;
    if (count > MOST_THINGS / 2) in.setstate(std::ios::failbit);
    Rows read(in ? count : 0, std::vector<double>(width));
    for (auto &row : read)
        for (double &number : row) in >> number;
    return read;
}

class Room {
    World world;
    Unit *const unit;
    size_t count = 0;

    PhysicalObject &another(double x, double y) {
        PhysicalObject *const thing = new (things + count++) PhysicalObject();
        thing->pos = Point(x, y);
        world.addObject(thing);
        return *thing;
    }

    // Enki 1.6.99 throws a robot that is no disc to the far side of a cylinder that it touches: for it they
    // have many sides.
    void round(PhysicalObject &thing, double radius) {
        if (unit->robot().isCylindric()) return thing.setCylindric(radius, HIGH_CM, FIXED);
        static std::map<double, PhysicalObject> made;  // Enki needs tens of ms for one
        if (!made.count(radius)) {
            const double corner = 2 * radius / (1 + cos(M_PI / SIDES));  // as far outside as the sides are inside
            Polygon sides;
            for (int i = 0; i < SIDES; ++i)
                sides.push_back(Point(corner * cos(2 * M_PI * i / SIDES), corner * sin(2 * M_PI * i / SIDES)));
            made[radius].setCustomHull(PhysicalObject::Hull(PhysicalObject::Part(sides, HIGH_CM)), FIXED);
        }
        const Point there = thing.pos;
        thing = made[radius];
        thing.pos = there;
    }

public:
    Room(Unit *unit, double width, double depth, const Rows &cylinders, const Rows &walls)
        : world(width, depth), unit(unit) {
        world.takeObjectOwnership = false;
        world.addObject(&unit->robot());
        for (const auto &row : cylinders) round(another(row[0], row[1]), row[2]);
        for (const auto &row : walls) {
            const Vector along(row[2] - row[0], row[3] - row[1]);
            PhysicalObject &wall = another((row[0] + row[2]) / 2, (row[1] + row[3]) / 2);
            wall.setRectangular(along.norm() + BOARD_CM, BOARD_CM, HIGH_CM, FIXED);
            wall.angle = along.angle();
        }
    }

    ~Room() {
        while (count) things[--count].~PhysicalObject();
        unit->~Unit();
    }

    void place(double x, double y, double heading, std::ostream &out) {
        DifferentialWheeled &robot = unit->robot();
        robot.pos = Point(x, y);
        robot.angle = heading;
        robot.speed = Vector(0, 0);
        robot.angSpeed = 0;
        run(1, 0, 0, out);
        robot.resetEncoders();
    }

    void run(int steps, double left, double right, std::ostream &out) {
        DifferentialWheeled &robot = unit->robot();
        robot.leftSpeed = left * unit->wheels[0];
        robot.rightSpeed = right * unit->wheels[1];
        for (int i = 0; i < steps; ++i) {
            world.step(STEP_S);
            out << robot.pos.x << ' ' << robot.pos.y << ' ' << robot.angle << ' ';
        }
        out << robot.leftOdometry / unit->wheels[0] << ' ' << robot.rightOdometry / unit->wheels[1] << ' '
            << robot.leftEncoder / unit->wheels[0] << ' ' << robot.rightEncoder / unit->wheels[1];
        for (const auto &sensor : unit->sensors) out << ' ' << sensor->getValue();
    }
};

int main() {
    std::unique_ptr<Room> room;
    for (std::string line, word, model; std::getline(std::cin, line);) {
        std::istringstream in(line);
        std::ostringstream out;
        out.precision(17);
        in >> word;
        if (word == "enter") {
            unsigned long seed;
            double noise, width, depth;
            room.reset();
            in >> model >> seed >> noise;
            std::srand(static_cast<unsigned>(seed ^ (seed >> 32)));
            Enki::random.setSeed(seed);
            Unit *const unit = in ? unit_of(model, in, noise, out) : nullptr;
            in >> width >> depth;
            const Rows cylinders = rows(in, 3), walls = rows(in, 4);
            if (unit) room.reset(new Room(unit, width, depth, cylinders, walls));
        } else if (room && word == "place") {
            double x, y, heading;
            if (in >> x >> y >> heading) room->place(x, y, heading, out);
        } else if (room && word == "run") {
            int steps;
            double left, right;
            if (in >> steps >> left >> right) room->run(steps, left, right, out);
        }
        if (!in || out.str().empty())
            std::cout << "error: not understood: " << line << std::endl;
        else
            std::cout << out.str() << std::endl;
    }
}
