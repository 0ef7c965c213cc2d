/* Readings from the standard input, commands to the standard output, as the exported controller gives them. */
#include <stdio.h>

#include "controller.h"

int main(void)
{
    int16_t readings[CONTROLLER_SENSORS], command[2];
    controller_t state;

    controller_reset(&state);
    while (fread(readings, sizeof readings, 1, stdin) == 1) {
        controller_drive(&state, readings, command);
        fwrite(command, sizeof command, 1, stdout);
    }
    return 0;
}
